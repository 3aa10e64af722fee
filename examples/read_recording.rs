//! Reads a recording and prints the largest contact force on every sprocket, with link, tooth gap and time.
//!
//! `cargo run --release --example read_recording -- recordings/samples/bush-20-40.mcap`

use pitchline::recording::reader::{Cursor, Reader};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "recordings/samples/bush-20-40.mcap".into());
    print!("{}", report(Path::new(&path))?);
    Ok(())
}

/// What this program prints.
pub fn report(path: &Path) -> Result<String, Box<dyn Error>> {
    let mut reader = Reader::open(path)?;
    // The header names links, bodies and columns; frames refer to them by index.
    let header = reader.header().clone();
    // Per body: force [N], link, tooth gap, time [s].
    let mut largest = vec![(0.0, 0, 0, 0.0); header.bodies.len()];
    let mut frames = Cursor::new(&mut reader);
    while let Some(frame) = frames.next_frame()? {
        let contacts = &frame.contacts;
        for row in 0..contacts.link.len() {
            let top = &mut largest[contacts.body[row] as usize];
            if contacts.normal_force_n[row] > top.0 {
                *top = (contacts.normal_force_n[row], contacts.link[row], contacts.tooth[row], frame.t_s);
            }
        }
    }
    let mut text = String::new();
    for (body, (force_n, link, tooth, t_s)) in header.bodies.iter().zip(largest).filter(|(body, _)| body.rotor) {
        let at_ms = t_s * 1e3;
        text += &format!("{}: {force_n:.1} N, link {link} on tooth gap {tooth} at {at_ms:.4} ms\n", body.path);
    }
    // Data that the file should hold and does not are listed, never passed over.
    for missing in reader.missing() {
        text += &format!("missing: {missing}\n");
    }
    Ok(text)
}

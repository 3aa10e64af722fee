//! Any bytes as the header and the frames of a recording whose chunks are whole: what is read is drawn and listed, or an error; never a
//! panic, never much memory. The bytes are parted by `%%%`: the header, then messages, the first byte of each its topic.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run frames -- -max_total_time=3600 -rss_limit_mb=1024 -max_len=65536
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use pitchline::render::snapshot::{SnapshotOptions, ViewCentre, draw};

const TOPICS: [&str; 5] =
    ["/pitchline/header", "/pitchline/frame", "/pitchline/keyframe", "/pitchline/event", "/pitchline/impact"];
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

fn put(into: &mut Vec<u8>, kind: u8, content: &[u8]) {
    into.push(kind);
    into.extend((content.len() as u64).to_le_bytes());
    into.extend(content);
}

fn text(into: &mut Vec<u8>, text: &str) {
    into.extend((text.len() as u32).to_le_bytes());
    into.extend(text.as_bytes());
}

fn message(into: &mut Vec<u8>, topic: u16, said: &[u8]) {
    let mut content = topic.to_le_bytes().to_vec();
    content.extend([0; 20]);
    content.extend(said);
    put(into, 5, &content);
}

/// A file of one chunk that is not packed.
fn recording(data: &[u8]) -> Vec<u8> {
    let mut inside = Vec::new();
    for (id, topic) in TOPICS.iter().enumerate() {
        let mut channel = (id as u16).to_le_bytes().to_vec();
        channel.extend([0; 2]);
        text(&mut channel, topic);
        text(&mut channel, "protobuf");
        channel.extend(0_u32.to_le_bytes());
        put(&mut inside, 4, &channel);
    }
    let mut parts = Vec::new();
    let mut from = 0;
    for (at, window) in data.windows(3).enumerate() {
        if window == b"%%%" && at >= from {
            parts.push(&data[from..at]);
            from = at + 3;
        }
    }
    parts.push(&data[from.min(data.len())..]);
    for (i, part) in parts.into_iter().enumerate() {
        match part.split_first() {
            _ if i == 0 => message(&mut inside, 0, part),
            Some((topic, said)) => message(&mut inside, u16::from(topic % 5), said),
            None => {}
        }
    }
    let mut chunk = vec![0; 16];
    chunk.extend((inside.len() as u64).to_le_bytes());
    chunk.extend(0_u32.to_le_bytes());
    text(&mut chunk, "");
    chunk.extend((inside.len() as u64).to_le_bytes());
    chunk.extend(inside);
    let mut file = MAGIC.to_vec();
    put(&mut file, 6, &chunk);
    file
}

fuzz_target!(|data: &[u8]| {
    let path = std::path::PathBuf::from(format!("/dev/shm/pitchline-fuzz-frames-{}.mcap", std::process::id()));
    if std::fs::write(&path, recording(data)).is_err() {
        return;
    }
    let Ok(mut reader) = Reader::open(&path) else { return };
    let header = reader.header().clone();
    let wanted = Wanted { frames: true, heads: false, keyframes: true, events: true, impacts: true };
    let mut frames = Vec::new();
    let _read = reader.each(wanted, WHOLE, |entry| {
        if let Entry::Frame(frame) = entry {
            frames.push(frame.clone());
        }
        Ok(Flow::On)
    });
    if let Some(frame) = frames.first() {
        let options = SnapshotOptions { around: ViewCentre::Drive, width_mm: Some(40.0), joints: true, impacts: &[] };
        assert!(draw(&header, &[frame], options).svg.ends_with("</svg>\n"));
    }
});

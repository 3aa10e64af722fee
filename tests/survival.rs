//! Recordings survive: killed runs, truncated, bit-flipped and hostile files, full disks.

use pitchline::recording::frame::{FORMAT_VERSION, Header};
use pitchline::recording::mcap;
use pitchline::recording::reader::{Flow, Reader, WHOLE, Wanted};
use pitchline::recording::{ViewOptions, create};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

const PROGRAM: &str = env!("CARGO_BIN_EXE_pitchline");
const EVERYTHING: Wanted = Wanted { frames: true, heads: false, keyframes: true, events: true, impacts: true };

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("recordings/samples/{name}-20-40.mcap"))
}

/// Reads a whole file; returns the number of messages, or the error.
fn read(path: &Path) -> Result<usize, String> {
    let mut reader = Reader::open(path).map_err(|e| format!("{e:#}"))?;
    let mut messages = 0;
    let result = reader.each(EVERYTHING, WHOLE, |_| {
        messages += 1;
        Ok(Flow::On)
    });
    result.map(|()| messages).map_err(|e| format!("{e:#}"))
}

/// Largest wall time that a killed run may lose [s], and the additional delay of an overloaded machine in writing a
/// chunk.
const LARGEST_LOSS_S: f64 = 0.2;
const SLOW_MACHINE_S: f64 = 0.3;

#[test]
fn a_run_killed_at_any_moment_leaves_a_file_that_opens() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut worst = 0.0_f64;
    let mut opened = 0;
    let mut late = 0;
    // A fast drive, one with few frames per second, and frames so far apart that only impacts and events come between
    // them.
    for (drive, kills, every) in [("bush-20-40", 42, "50us"), ("smartchain-20-40", 4, "50us"), ("bush-20-40", 4, "1s")]
    {
        for kill in 0..kills {
            let path = folder.path().join("killed.mcap");
            let _gone = std::fs::remove_file(&path);
            let mut child = Command::new(PROGRAM)
                .args(["run", drive, "--duration", "100s", "--every", every, "-o"])
                .arg(&path)
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .expect("starts");
            // Time counts from the creation of its file.
            let waiting = Instant::now();
            while !path.exists() && waiting.elapsed() < Duration::from_secs(120) {
                std::thread::sleep(Duration::from_millis(2));
            }
            let sparse = if every == "1s" { 500 } else { 0 };
            std::thread::sleep(Duration::from_millis(15 + 7 * kill + sparse));
            child.kill().expect("was running");
            let killed = SystemTime::now();
            child.wait().expect("ends");
            let written = std::fs::metadata(&path).and_then(|m| m.modified()).expect("a file");
            let reader = match Reader::open(&path) {
                Ok(reader) => reader,
                Err(e) => panic!("{drive}, killed after {kill}: {e:#}"),
            };
            assert!(!reader.complete());
            assert!(reader.loss().expect("says so").contains("was not finished"));
            read(&path).expect("readable");
            opened += 1;
            let lost_s = killed.duration_since(written).map_or(0.0, |d| d.as_secs_f64());
            worst = worst.max(lost_s);
            late += u32::from(lost_s > LARGEST_LOSS_S);
        }
    }
    println!(
        "{opened} killed runs opened; at most {worst:.3} s between the last write and the end, {late} times more than allowed"
    );
    // A busy machine may delay a run, but not often.
    assert!(late <= 2 && worst < LARGEST_LOSS_S + SLOW_MACHINE_S);
}

/// Exit code 130 means that files are finished: a second Ctrl-C that truncates them ends with 1 and reports it.
#[cfg(unix)]
#[test]
fn interrupted_runs_finish_their_files_or_say_that_they_did_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut finished, mut cut) = (0, 0);
    for signals in [1, 2, 2, 2, 2, 2] {
        let path = folder.path().join("interrupted.mcap");
        let _gone = std::fs::remove_file(&path);
        let child = Command::new(PROGRAM)
            .args(["run", "bush-20-40", "--duration", "100s", "--every", "200us", "-o"])
            .arg(&path)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let waiting = Instant::now();
        while !path.exists() && waiting.elapsed() < Duration::from_secs(120) {
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(Duration::from_millis(100));
        for _ in 0..signals {
            let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("there is a kill");
            assert!(sent.success() || signals == 2);
            std::thread::sleep(Duration::from_millis(1));
        }
        let out = child.wait_with_output().expect("ends");
        let said = String::from_utf8_lossy(&out.stderr);
        let reader = Reader::open(&path).unwrap_or_else(|e| panic!("{e:#}"));
        match out.status.code() {
            Some(130) => {
                assert!(reader.complete(), "{said}");
                finished += 1;
            }
            Some(1) => {
                assert!(signals == 2 && said.contains("interrupted twice"), "{said}");
                cut += 1;
            }
            other => panic!("{other:?}: {said}"),
        }
    }
    println!("{finished} finished, {cut} cut short");
    assert!(finished >= 1);
}

#[test]
fn cut_files_are_read_up_to_their_last_whole_chunk_and_repaired() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(sample("bush")).expect("readable");
    let (cut, mended) = (folder.path().join("cut.mcap"), folder.path().join("mended.mcap"));
    let mut opened = 0;
    for k in 0..60 {
        std::fs::write(&cut, &bytes[..bytes.len() * k / 60]).expect("writable");
        match Reader::open(&cut) {
            Ok(reader) => {
                assert!(!reader.complete());
                opened += 1;
            }
            Err(e) => assert!(format!("{e:#}").contains("cut.mcap"), "{e:#}"),
        }
    }
    assert!(opened > 20, "{opened} of 60");
    std::fs::write(&cut, &bytes[..bytes.len() - 4000]).expect("writable");
    let out =
        Command::new(PROGRAM).args(["replay", "--repair"]).arg(&cut).arg("-o").arg(&mended).output().expect("runs");
    // Done, with reported losses.
    assert_eq!(out.status.code(), Some(3), "{}", String::from_utf8_lossy(&out.stderr));
    let (before, after) = (mcap::read(&cut).expect("readable"), mcap::read(&mended).expect("readable"));
    assert!(after.complete && after.frames == before.frames && !after.frames.is_empty());
}

#[test]
fn flipped_bits_never_panic_and_errors_name_the_byte() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("flipped.mcap");
    let bytes = std::fs::read(sample("smartchain")).expect("readable");
    let (mut errors, mut named, mut harmless) = (0, 0, 0);
    let mut seed = 1_u64;
    for _ in 0..400 {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mut flipped = bytes.clone();
        let at = (seed >> 20) as usize % bytes.len();
        flipped[at] ^= 1 << (seed >> 61);
        std::fs::write(&path, &flipped).expect("writable");
        match read(&path) {
            Ok(_) => harmless += 1,
            Err(e) => {
                errors += 1;
                named += usize::from(e.contains("byte"));
                assert!(e.contains("flipped.mcap"), "{e}");
            }
        }
    }
    println!("{errors} damaged, {named} of them with the byte; {harmless} without effect on what is read");
    assert!(errors > 300 && named * 10 > errors * 9);
}

/// A file of one record after the magic bytes.
fn hostile(kind: u8, length: u64, content: &[u8]) -> Vec<u8> {
    let mut bytes = ::mcap::MAGIC.to_vec();
    bytes.push(kind);
    bytes.extend(length.to_le_bytes());
    bytes.extend(content);
    bytes
}

#[test]
fn hostile_files_are_refused_in_bounded_memory() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("hostile.mcap");
    let chunk = |unpacked: u64, compression: &[u8], packed: u64, data: &[u8]| {
        let mut content = vec![0; 16];
        content.extend(unpacked.to_le_bytes());
        content.extend(0_u32.to_le_bytes());
        content.extend((compression.len() as u32).to_le_bytes());
        content.extend(compression);
        content.extend(packed.to_le_bytes());
        content.extend(data);
        let length = content.len() as u64;
        hostile(6, length, &content)
    };
    // A decompression bomb: 60 MB of zeros in a few kB, and one with a false size.
    let bomb = zstd::encode_all(std::io::Cursor::new(vec![0_u8; 60 << 20]), 19).expect("packs");
    let inner_lie = {
        // An unpacked record of 2^63 bytes inside a chunk.
        let mut record = vec![5];
        record.extend((1_u64 << 63).to_le_bytes());
        record
    };
    let cases = [
        hostile(6, u64::MAX, &[]),
        hostile(6, u64::MAX - 8, &[0; 64]),
        hostile(6, 8, &[0; 8]),
        hostile(1, 0, &[]),
        hostile(0, 0, &[]),
        chunk(u64::MAX, b"zstd", 4, &[1, 2, 3, 4]),
        chunk(1 << 40, b"", 4, &[1, 2, 3, 4]),
        chunk(10, b"zstd", u64::MAX, &[1, 2, 3, 4]),
        chunk(10, b"zstd", bomb.len() as u64, &bomb),
        chunk(60 << 20, b"zstd", bomb.len() as u64, &bomb),
        chunk(10, b"lz4", 4, &[1, 2, 3, 4]),
        chunk(10, b"zstd", 4, &[1, 2, 3, 4]),
        chunk(9, b"", 9, &inner_lie),
        Vec::new(),
        ::mcap::MAGIC.to_vec(),
        b"RRF2 something".to_vec(),
    ];
    for (i, bytes) in cases.iter().enumerate() {
        std::fs::write(&path, bytes).expect("writable");
        let error = Reader::open(&path).err().unwrap_or_else(|| panic!("case {i} opens"));
        println!("{i}: {error:#}");
    }
    let view = folder.path().join("a.rrd");
    std::fs::write(&view, b"RRF2").expect("writable");
    assert!(Reader::open(&view).err().expect("refused").to_string().contains("give the .mcap"));
    // A header with inconsistent columns must not cause invalid indexing.
    let links = vec![Default::default(); 3];
    let link_outlines = vec![Default::default()];
    let header = Header {
        drive_name: "odd".into(),
        format_version: FORMAT_VERSION,
        step_s: 1e-6,
        links,
        link_outlines,
        ..Header::default()
    };
    let mut sink = create(&path, &header, ViewOptions::default()).expect("opens");
    let mut frame = pitchline::recording::frame::Frame::default();
    let l = &mut frame.links;
    for column in [&mut l.x_m, &mut l.y_m, &mut l.angle_rad, &mut l.vx_m_s, &mut l.vy_m_s, &mut l.omega_rad_s] {
        *column = vec![0.0; 3];
    }
    let _written = sink.frame(&frame);
    sink.finish().expect("finishes");
    assert!(read(&path).expect_err("refused").contains("different lengths"));
    for verb in [&["impacts"][..], &["replay", "--verify"], &["explain", "--link", "0", "--at", "0s"]] {
        let out = Command::new(PROGRAM).args(verb).arg(&path).output().expect("runs");
        assert!(!String::from_utf8_lossy(&out.stderr).contains("panicked"), "{verb:?}");
    }
}

#[test]
fn a_disk_that_fills_up_keeps_what_was_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("full.mcap");
    let script =
        format!("ulimit -f 4000; trap '' XFSZ; '{PROGRAM}' run bush-20-40 --duration 200ms -o '{}'", path.display());
    let out = Command::new("bash").args(["-c", &script]).output().expect("bash");
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("full.mcap") && said.contains("kept"), "{said}");
    let frames = read(&path).expect("opens");
    println!("{frames} messages kept: {said}");
    assert!(frames > 100);
}

#[test]
fn recordings_of_the_longest_chains_can_be_read() {
    // 2000 links with two contacts each: 128 such frames in one chunk would exceed a reader's limit.
    let (links, rows) = (2000, 4000);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("long.mcap");
    let bodies = vec![Default::default()];
    let header = Header {
        drive_name: "long".into(),
        format_version: FORMAT_VERSION,
        step_s: 1e-6,
        links: vec![Default::default(); links],
        link_outlines: vec![Default::default()],
        bodies,
        ..Header::default()
    };
    let mut frame = pitchline::recording::frame::Frame::default();
    let l = &mut frame.links;
    for column in [&mut l.x_m, &mut l.y_m, &mut l.angle_rad, &mut l.vx_m_s, &mut l.vy_m_s, &mut l.omega_rad_s] {
        *column = vec![0.5; links];
    }
    for column in [&mut l.ax_m_s2, &mut l.ay_m_s2, &mut l.alpha_rad_s2] {
        *column = vec![0.5; links];
    }
    let j = &mut frame.joints;
    for column in [&mut j.force_x_n, &mut j.force_y_n, &mut j.friction_torque_nm] {
        *column = vec![0.5; links];
    }
    let c = &mut frame.contacts;
    for column in [&mut c.link, &mut c.feature, &mut c.body, &mut c.tooth, &mut c.segment] {
        *column = vec![0; rows];
    }
    for column in [
        &mut c.point_body_x_m,
        &mut c.point_body_y_m,
        &mut c.point_link_x_m,
        &mut c.point_link_y_m,
        &mut c.normal_x,
        &mut c.normal_y,
        &mut c.penetration_m,
        &mut c.approach_speed_m_s,
        &mut c.normal_speed_m_s,
        &mut c.tangential_speed_m_s,
        &mut c.normal_force_n,
        &mut c.tangential_force_n,
        &mut c.age_s,
        &mut c.instant_force_n,
    ] {
        *column = vec![0.5; rows];
    }
    c.stick = vec![true; rows];
    let view = ViewOptions::every(1.0);
    let mut sink = create(&path, &header, view).expect("opens");
    for step in 0..mcap::FRAMES_PER_CHUNK {
        (frame.step, frame.t_s) = (step, step as f64 * 1e-6);
        sink.frame(&frame).expect("writes");
    }
    sink.finish().expect("finishes");
    assert_eq!(read(&path), Ok(mcap::FRAMES_PER_CHUNK as usize));
}

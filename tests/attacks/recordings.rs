//! Recordings that were truncated, bit-flipped, or unpacked, changed and packed again: the data read equal the data
//! written, or a message reports the difference.

use super::{Random, run, sample};
use mcap::records::op;
use pitchline::recording::reader::{Entry, Flow, Reader, WHOLE, Wanted};
use std::path::Path;

const EVERYTHING: Wanted = Wanted { frames: true, heads: false, keyframes: true, events: true, impacts: true };

/// The content of a recording, and the data that its reader reports as missing.
fn read(path: &Path) -> Result<(Vec<String>, Vec<String>), String> {
    let mut reader = Reader::open(path).map_err(|e| format!("{e:#}"))?;
    let mut all = vec![format!("{:?}", reader.header())];
    reader
        .each(EVERYTHING, WHOLE, |entry| {
            all.push(match entry {
                Entry::Frame(frame) => format!("{frame:?}"),
                other => format!("{other:?}"),
            });
            Ok(Flow::On)
        })
        .map_err(|e| format!("{e:#}"))?;
    Ok((all, reader.missing().to_vec()))
}

/// Records of a file after its magic bytes: kind and content.
fn records(bytes: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let mut at = mcap::MAGIC.len();
    let mut all = Vec::new();
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().expect("eight")) as usize;
        let Some(content) = bytes.get(at + 9..at + 9 + length) else { break };
        all.push((bytes[at], content.to_vec()));
        at += 9 + length;
    }
    all
}

fn put(into: &mut Vec<u8>, kind: u8, content: &[u8]) {
    into.push(kind);
    into.extend((content.len() as u64).to_le_bytes());
    into.extend(content);
}

/// The file with its chunks changed inside, with correct checksums, and with its table of contents kept or left out.
fn repacked(bytes: &[u8], with_contents: bool, mut change: impl FnMut(usize, &mut Vec<(u8, Vec<u8>)>)) -> Vec<u8> {
    let mut file = mcap::MAGIC.to_vec();
    let mut chunks = 0;
    for (kind, content) in records(bytes) {
        if kind == op::CHUNK {
            // Frames are not packed.
            let name_length = usize::from(content[28]);
            let packed = &content[8 + 8 + 8 + 4 + 4 + name_length + 8..];
            let unpacked = if name_length == 0 { packed.to_vec() } else { zstd::decode_all(packed).expect("our own") };
            let mut magic = mcap::MAGIC.to_vec();
            magic.extend(unpacked);
            let mut inside = records(&magic);
            change(chunks, &mut inside);
            chunks += 1;
            let mut unpacked = Vec::new();
            inside.iter().for_each(|(kind, content)| put(&mut unpacked, *kind, content));
            let packed = zstd::encode_all(unpacked.as_slice(), 1).expect("packs");
            let mut chunk = content[..16].to_vec();
            chunk.extend((unpacked.len() as u64).to_le_bytes());
            chunk.extend(crc32fast::hash(&unpacked).to_le_bytes());
            chunk.extend(4_u32.to_le_bytes());
            chunk.extend(b"zstd");
            chunk.extend((packed.len() as u64).to_le_bytes());
            chunk.extend(packed);
            put(&mut file, kind, &chunk);
        } else if with_contents || !matches!(kind, op::CHUNK_INDEX | op::STATISTICS) {
            put(&mut file, kind, &content);
        }
    }
    file.extend(mcap::MAGIC);
    file
}

/// Channel number of frames in these files.
const FRAMES: u16 = 2;

fn is_frame((kind, content): &(u8, Vec<u8>)) -> bool {
    *kind == op::MESSAGE && u16::from_le_bytes([content[0], content[1]]) == FRAMES
}

#[test]
fn cut_and_flipped_recordings_never_answer_otherwise_in_silence() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("changed.mcap");
    let whole = std::fs::read(sample()).expect("the sample");
    let (truth, missing) = read(&sample()).expect("readable");
    assert!(missing.is_empty(), "{missing:?}");
    let (mut errors, mut told, mut same) = (0, 0, 0);
    for case in 0..300 {
        let mut random = Random(40_000 + case);
        let mut bytes = whole.clone();
        if case % 3 == 0 {
            bytes.truncate(random.below(whole.len()));
        } else {
            for _ in 0..=random.below(3) {
                // Half of them in the table of contents.
                let from = if random.below(2) == 0 { whole.len() - 4000 } else { 0 };
                let at = from + random.below(whole.len() - from);
                bytes[at] ^= 1 << random.below(8);
            }
        }
        std::fs::write(&path, &bytes).expect("written");
        match read(&path) {
            Err(e) => {
                assert!(e.contains("changed.mcap"), "case {case}: {e}");
                errors += 1;
            }
            Ok((all, missing)) if missing.is_empty() => {
                assert!(all == truth, "case {case}: other answers, and not a word");
                same += 1;
            }
            Ok(_) => told += 1,
        }
    }
    println!("{errors} refused, {told} with a warning, {same} the same");
    assert!(errors > 100 && told > 20);
}

#[test]
fn recordings_packed_again_never_answer_otherwise_in_silence() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("changed.mcap");
    let whole = std::fs::read(sample()).expect("the sample");
    let (truth, _) = read(&sample()).expect("readable");
    std::fs::write(&path, repacked(&whole, false, |_, _| ())).expect("written");
    assert_eq!(read(&path).map(|(all, _)| all == truth), Ok(true), "packed again without a change");
    let n_frames = |inside: &[(u8, Vec<u8>)]| inside.iter().filter(|r| is_frame(r)).count();
    let mut told = 0;
    for case in 0..160 {
        let mut random = Random(50_000 + case);
        let (how, with_contents) = (random.below(6), random.below(2) == 0);
        let mut left = random.below(20);
        let mut changed = false;
        let bytes = repacked(&whole, with_contents, |_, inside| {
            // The first and the last frame may be left out, as in a shorter run, which cannot be detected.
            let frames: Vec<usize> = (0..inside.len()).filter(|i| is_frame(&inside[*i])).collect();
            if changed || frames.len() < 4 || left > n_frames(inside) {
                left = left.saturating_sub(1);
                return;
            }
            changed = true;
            let at = frames[1 + random.below(frames.len() - 2)];
            match how {
                0 => drop(inside.remove(at)),
                1 => inside.insert(at, inside[at].clone()),
                2 => inside[at].0 = 0x40,
                3 => inside[at].1[0] = 200,
                4 => inside.swap(at, frames[0]),
                // Another log time.
                _ => inside[at].1[6..14].copy_from_slice(&(1_u64 << 62).to_le_bytes()),
            }
        });
        std::fs::write(&path, &bytes).expect("written");
        match read(&path) {
            Err(_) => told += 1,
            Ok((_, missing)) if !missing.is_empty() => told += 1,
            Ok((all, _)) => assert!(all == truth, "case {case}, kind {how}: other answers, and not a word"),
        }
    }
    assert!(told > 80, "{told}");
}

#[test]
fn a_chunk_that_is_none_any_more_is_missed_by_every_verb() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let recorded = run(folder.path(), &["run", "bush-20-40", "--duration", "8ms", "-o", "whole.mcap"]);
    assert!(recorded.status.success());
    let whole = std::fs::read(at("whole.mcap")).expect("a recording");
    // A chunk of frames that is not the first gets an unknown kind; then another file is truncated in its middle.
    let mut place = mcap::MAGIC.len();
    let mut chunks = Vec::new();
    for (kind, content) in records(&whole) {
        if kind == op::CHUNK {
            chunks.push(place);
        }
        place += 9 + content.len();
    }
    let mut renamed = whole.clone();
    renamed[chunks[3]] = 0x60;
    std::fs::write(at("renamed.mcap"), renamed).expect("written");
    std::fs::write(at("cut.mcap"), &whole[..whole.len() / 2]).expect("written");
    for file in ["renamed.mcap", "cut.mcap"] {
        for args in [
            vec!["impacts", file],
            vec!["impacts", file, "--json"],
            vec!["impacts", "whole.mcap", "--against", file],
            vec!["audit", file],
            vec!["audit", "whole.mcap", "--against", file],
            vec!["spectrum", file, "sprocket.driven.speed"],
            vec!["diff", "whole.mcap", file],
            vec!["diff", file, "whole.mcap", "--json"],
            vec!["export", file, "-o", "tables/"],
            vec!["snapshot", file, "--at", "0.2ms", "-o", "s.svg"],
            vec!["explain", file, "--link", "3", "--at", "0.2ms"],
            vec!["zoom", file, "--from", "0.1ms", "--to", "0.2ms", "-o", "z.mcap"],
            vec!["replay", "--verify", file],
            vec!["replay", "--repair", file, "-o", "r.mcap"],
        ] {
            let out = run(folder.path(), &args);
            let said = String::from_utf8_lossy(&out.stderr);
            assert_eq!(out.status.code(), Some(3), "{args:?}: {said}");
            assert!(said.contains("warning: ") && said.contains(file), "{args:?}: {said}");
            if args.contains(&"--json") {
                let json: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
                assert!(json["missing"].as_array().is_some_and(|m| !m.is_empty()), "{args:?}");
            }
        }
    }
    let verified = run(folder.path(), &["replay", "--verify", "renamed.mcap"]);
    let said = String::from_utf8_lossy(&verified.stdout);
    assert!(said.contains("frames that should be there are missing"), "{said}");
}

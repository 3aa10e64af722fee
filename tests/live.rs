//! Live runs: a viewer gets the recorded data, and no viewer can stop a run.

#![cfg(all(unix, feature = "live", feature = "rerun"))]

#[allow(dead_code)]
#[path = "common/readers.rs"]
mod readers;

use foxglove::messages::{FrameTransforms, SceneUpdate};
use pitchline::recording::frame::{Frame, Header};
use pitchline::recording::mcap::{self, TOPICS};
use prost::Message;
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

fn pitchline(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pitchline"));
    command.args(["run", "bush-20-40"]).args(args).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// A port without a listener, most likely still free shortly after.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address").port()
}

/// A Rerun server that writes what it receives. The program is a script that starts the real one: both are ended.
struct Server(Option<Child>);

impl Server {
    fn start(port: u16, save: &Path) -> Option<Server> {
        let program = readers::rerun()?;
        let port_text = port.to_string();
        let mut command = Command::new(&program);
        command.args(["--serve-grpc", "--bind", "127.0.0.1", "--port", &port_text, "--save"]).arg(save);
        command.env("RERUN_ANALYTICS", "0").stdout(Stdio::null()).stderr(Stdio::null());
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let child = command.spawn().expect("started before");
        let started = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(started.elapsed() < Duration::from_secs(60), "{program} does not listen");
            std::thread::sleep(Duration::from_millis(50));
        }
        Some(Server(Some(child)))
    }

    fn kill(&mut self) {
        let Some(mut child) = self.0.take() else { return };
        let group = format!("-{}", child.id());
        let _killed = Command::new("kill").args(["-KILL", "--", &group]).status();
        let _ended = child.wait();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Rows of `entity` in an `.rrd`, also in one that is still being written.
fn rows(path: &Path, entity: &str) -> usize {
    let Ok(file) = std::fs::File::open(path) else { return 0 };
    let chunks =
        DecoderApp::decode_lazy(BufReader::new(file)).map_while(Result::ok).filter_map(|message| match message {
            LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(&message).ok(),
            _ => None,
        });
    chunks
        .filter(|chunk| chunk.entity_path().to_string() == entity && !chunk.is_static())
        .map(|chunk| chunk.num_rows())
        .sum()
}

#[test]
fn rerun_gets_every_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let (seen, kept) = (folder.path().join("seen.rrd"), folder.path().join("kept.mcap"));
    let port = free_port();
    let Some(server) = Server::start(port, &seen) else { return };
    let viewer = format!("rerun=rerun+http://127.0.0.1:{port}/proxy");
    let path = kept.to_str().expect("text");
    let out = pitchline(&["--duration", "30ms", "-o", path, "--live", &viewer]).output().expect("runs");
    assert!(out.status.success(), "{}", stderr(&out));
    let frames = mcap::read(&kept).expect("recorded as well").frames.len();
    // The server writes its data with a small delay.
    let started = Instant::now();
    while rows(&seen, "/state/frame") < frames && started.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(200));
    }
    for entity in ["/state/frame", "/state/contacts", "/plots/speed"] {
        assert_eq!(rows(&seen, entity), frames, "{entity}");
    }
    drop(server);
}

#[test]
fn a_viewer_that_goes_away_stops_no_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let (seen, kept) = (folder.path().join("seen.rrd"), folder.path().join("kept.mcap"));
    let port = free_port();
    let Some(mut server) = Server::start(port, &seen) else { return };
    let viewer = format!("rerun=rerun+http://127.0.0.1:{port}/proxy");
    let path = kept.to_str().expect("text");
    let args = ["--duration", "30ms", "-o", path, "--live", &viewer, "--live-speed", "0.01"];
    let run = pitchline(&args).spawn().expect("starts");
    std::thread::sleep(Duration::from_millis(1500));
    server.kill();
    let out = run.wait_with_output().expect("ends");
    assert!(out.status.success(), "{}", stderr(&out));
    assert_eq!(stderr(&out).matches("lost the viewer").count(), 1, "{}", stderr(&out));
    let recording = mcap::read(&kept).expect("readable");
    assert!(recording.complete && recording.frames.last().is_some_and(|frame| frame.t_s > 0.0299));
}

#[test]
fn a_viewer_that_is_not_there_is_an_error_and_touches_no_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let file = path.to_str().expect("text");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let taken_port = taken.local_addr().expect("an address").port();
    let cases = [
        (format!("rerun=rerun+http://127.0.0.1:{}/proxy", free_port()), 1, "no Rerun viewer at rerun+http://127.0.0.1"),
        ("rerun=nowhere".into(), 1, "nowhere"),
        (format!("foxglove={taken_port}"), 1, "cannot listen at ws://127.0.0.1"),
        ("foxglove=0".into(), 1, "no Foxglove at ws://127.0.0.1"),
        ("foxglove=x".into(), 2, "foxglove=PORT"),
        ("vlc".into(), 2, "foxglove=PORT"),
    ];
    for (viewer, code, says) in cases {
        let args = ["--duration", "1ms", "-o", file, "--live", &viewer, "--live-wait", "200ms"];
        let out = pitchline(&args).output().expect("runs");
        assert_eq!(out.status.code(), Some(code), "{viewer}: {}", stderr(&out));
        assert!(stderr(&out).contains(says), "{viewer}: {}", stderr(&out));
        assert!(!path.exists());
    }
}

/// A run that waits for Foxglove, its address after `ws://`, and its later output.
fn serving(args: &[&str]) -> (Child, String, JoinHandle<String>) {
    let mut command = pitchline(&["--no-output", "--live", "foxglove=0", "--live-wait", "60s"]);
    let mut run = command.args(args).spawn().expect("runs");
    let mut said = String::new();
    let mut lines = BufReader::new(run.stderr.take().expect("piped"));
    while !said.contains("ws://") {
        assert!(lines.read_line(&mut said).expect("text") > 0, "{said}");
    }
    let address = said.split("ws://").nth(1).expect("an address").split(';').next().expect("its end").to_string();
    // Read to the end, so that the run never waits for this test.
    let rest = std::thread::spawn(move || {
        let mut rest = String::new();
        lines.read_to_string(&mut rest).expect("text");
        rest
    });
    (run, address, rest)
}

/// The part of a WebSocket client that is needed to receive (RFC 6455).
struct WebSocket(BufReader<TcpStream>);

impl WebSocket {
    fn connect(address: &str) -> WebSocket {
        let (host, token) = address.split_once('/').expect("a token");
        let mut stream = TcpStream::connect(host).expect("somebody listens");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a limit");
        let request = format!(
            "GET /{token} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: cGl0Y2hsaW5lcGl0Y2hsaQ==\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).expect("sent");
        let mut reader = BufReader::new(stream);
        let mut answer = String::new();
        while !answer.ends_with("\r\n\r\n") {
            assert!(reader.read_line(&mut answer).expect("an answer") > 0, "{answer}");
        }
        assert!(answer.starts_with("HTTP/1.1 101"), "{answer}");
        WebSocket(reader)
    }

    /// A text, masked with zeros.
    fn send(&mut self, text: &str) {
        let length = u16::try_from(text.len()).expect("short").to_be_bytes();
        let mut frame = vec![0x81, 0x80 | 126, length[0], length[1], 0, 0, 0, 0];
        frame.extend(text.as_bytes());
        self.0.get_mut().write_all(&frame).expect("sent");
    }

    /// Kind (1 text, 2 binary) and content of the next message; None at the end.
    fn next(&mut self) -> Option<(u8, Vec<u8>)> {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).ok()?;
        let extended = match head[1] & 0x7f {
            126 => 2,
            127 => 8,
            _ => 0,
        };
        let mut bytes = [0; 8];
        self.0.read_exact(&mut bytes[8 - extended..]).ok()?;
        let length = if extended == 0 { u64::from(head[1] & 0x7f) } else { u64::from_be_bytes(bytes) };
        let mut content = vec![0; length as usize];
        self.0.read_exact(&mut content).ok()?;
        assert!(head[0] & 0x80 != 0, "messages come whole");
        (head[0] & 0x0f != 8).then_some((head[0] & 0x0f, content))
    }
}

/// Subscribes to all topics; messages by topic in order of arrival.
fn listen(socket: &mut WebSocket) -> BTreeMap<String, Vec<Vec<u8>>> {
    let mut topics: BTreeMap<u32, String> = BTreeMap::new();
    let mut messages: BTreeMap<String, Vec<Vec<u8>>> = BTreeMap::new();
    while let Some((kind, content)) = socket.next() {
        if kind == 1 {
            let said: serde_json::Value = serde_json::from_slice(&content).expect("JSON");
            for channel in said["channels"].as_array().into_iter().flatten() {
                let id = channel["id"].as_u64().expect("an id") as u32;
                assert_eq!(channel["encoding"], "protobuf");
                assert!(channel["schema"].as_str().is_some_and(|schema| !schema.is_empty()));
                topics.insert(id, channel["topic"].as_str().expect("a topic").to_string());
                socket
                    .send(&format!("{{\"op\":\"subscribe\",\"subscriptions\":[{{\"id\":{id},\"channelId\":{id}}}]}}"));
            }
        } else if kind == 2 && content[0] == 1 {
            let id = u32::from_le_bytes(content[1..5].try_into().expect("four bytes"));
            messages.entry(topics[&id].clone()).or_default().push(content[13..].to_vec());
        }
    }
    assert_eq!(topics.len(), TOPICS.len());
    messages
}

#[test]
fn foxglove_gets_the_topics_of_the_archive() {
    // Slow enough that no message is dropped.
    let (mut run, address, _) = serving(&["--duration", "20ms", "--live-speed", "0.02"]);
    let messages = listen(&mut WebSocket::connect(&address));
    assert!(run.wait().expect("ends").success());
    for (topic, _) in TOPICS {
        println!("{topic}: {} messages", messages.get(topic).map_or(0, Vec::len));
        // A snapshot is taken at the first frame, which may come before all topics are subscribed to.
        assert!(topic == "/pitchline/keyframe" || messages.contains_key(topic), "{topic}");
    }
    let header = Header::decode(messages["/pitchline/header"][0].as_slice()).expect("a header");
    assert_eq!((header.drive_name.as_str(), header.links.len()), ("bush-20-40", 90));
    let scenes = |topic: &str| -> Vec<SceneUpdate> {
        messages[topic].iter().map(|m| SceneUpdate::decode(m.as_slice()).expect("a scene")).collect()
    };
    // Outlines, and beside them an arrow with the scale of forces.
    assert_eq!(scenes("/drive")[0].entities.len(), header.links.len() + header.bodies.len() + 1);
    assert!(scenes("/scene").iter().all(|s| s.entities.len() == 1 && !s.entities[0].arrows.is_empty()));
    let transforms = FrameTransforms::decode(messages["/tf"][0].as_slice()).expect("transforms");
    assert_eq!(transforms.transforms.len(), header.links.len() + header.bodies.len());
    let frames: Vec<Frame> =
        messages["/pitchline/frame"].iter().map(|m| Frame::decode(m.as_slice()).expect("a frame")).collect();
    let steps_apart = frames.windows(2).all(|w| w[1].step - w[0].step == header.steps_per_frame || w[1].t_s > 0.0199);
    assert!(steps_apart && frames.last().is_some_and(|f| f.t_s > 0.0199), "{} frames, none left out", frames.len());
}

#[test]
fn foxglove_may_go_away() {
    let (mut run, address, said) = serving(&["--duration", "10ms", "--live-speed", "0.01"]);
    let mut socket = WebSocket::connect(&address);
    while socket.next().is_some_and(|(kind, content)| kind != 1 || !content.windows(5).any(|w| w == b"\"/tf\"")) {}
    for id in 1..=TOPICS.len() {
        socket.send(&format!("{{\"op\":\"subscribe\",\"subscriptions\":[{{\"id\":{id},\"channelId\":{id}}}]}}"));
    }
    while socket.next().is_some_and(|(kind, _)| kind != 2) {}
    drop(socket);
    assert!(run.wait().expect("ends").success());
    let said = said.join().expect("read");
    assert_eq!(said.matches("nobody watches").count(), 1, "{said}");
}

#[test]
fn python_listens_as_foxglove_does() {
    let Some(python) = readers::python("websockets, google.protobuf") else { return };
    let (mut run, address, _) = serving(&["--duration", "10ms", "--live-speed", "0.02"]);
    let script = format!("{}/tests/read_foxglove.py", env!("CARGO_MANIFEST_DIR"));
    let out = Command::new(&python).arg(script).arg(&address).output().expect("runs");
    let said = String::from_utf8_lossy(&out.stdout);
    println!("{said}");
    assert!(out.status.success(), "{said}{}", stderr(&out));
    assert!(run.wait().expect("ends").success());
}

/// Values of all keys of this name, anywhere in a JSON value.
fn found<'a>(value: &'a serde_json::Value, key: &str, into: &mut Vec<&'a serde_json::Value>) {
    match value {
        serde_json::Value::Object(map) => map.iter().for_each(|(k, v)| {
            if k == key {
                into.push(v);
            }
            found(v, key, into);
        }),
        serde_json::Value::Array(list) => list.iter().for_each(|v| found(v, key, into)),
        _ => {}
    }
}

#[test]
fn the_foxglove_layout_fits_our_topics() {
    let root = env!("CARGO_MANIFEST_DIR");
    let text = std::fs::read_to_string(format!("{root}/assets/foxglove/pitchline.json")).expect("the layout");
    let proto = std::fs::read_to_string(format!("{root}/assets/pitchline.proto")).expect("the schema");
    let layout: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let panels = layout["configById"].as_object().expect("panels");
    // Panels are placed once each, and have kinds that Foxglove supports.
    let mut placed = Vec::new();
    ["first", "second"].iter().for_each(|side| found(&layout["layout"], side, &mut placed));
    let mut placed: Vec<&str> = placed.into_iter().filter_map(serde_json::Value::as_str).collect();
    placed.sort_unstable();
    assert_eq!(placed, panels.keys().map(String::as_str).collect::<Vec<_>>());
    for kind in panels.keys().map(|id| id.split('!').next().unwrap_or_default()) {
        assert!(["3D", "Plot", "RawMessages", "Table", "RosOut"].contains(&kind), "{kind}");
    }
    // Topics exist, and so do the selected fields.
    let mut paths = Vec::new();
    ["value", "topicPath", "topicToRender"].iter().for_each(|key| found(&layout["configById"], key, &mut paths));
    let mut paths: Vec<&str> = paths.into_iter().filter_map(serde_json::Value::as_str).collect();
    paths.extend(panels["3D!drive"]["topics"].as_object().expect("topics").keys().map(String::as_str));
    assert!(paths.len() >= 9, "{paths:?}");
    for path in paths {
        let (topic, field) = path.split_once('.').map_or((path, None), |(topic, field)| (topic, Some(field)));
        let schema = TOPICS.iter().find(|(name, _)| *name == topic).map(|(_, schema)| *schema);
        let schema = schema.unwrap_or_else(|| panic!("no topic {topic}"));
        let Some(field) = field.and_then(|field| field.split('[').next()) else { continue };
        let message = schema.strip_prefix("pitchline.").expect("one of ours");
        let body = proto.split(&format!("message {message} {{")).nth(1).and_then(|rest| rest.split("\n}").next());
        assert!(body.is_some_and(|body| body.contains(&format!(" {field} = "))), "{path}");
    }
}

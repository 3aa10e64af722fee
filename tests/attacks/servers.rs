//! Hostile clients: foreign web pages, programs that never read, request heads without an end.

use super::{PROGRAM, sample};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

fn memory_kb(child: &Child) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    peak.and_then(|l| l.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

fn connect(port: u16) -> TcpStream {
    let stream = TcpStream::connect(("127.0.0.1", port)).expect("somebody listens");
    stream.set_read_timeout(Some(Duration::from_secs(10))).expect("a limit");
    stream.set_write_timeout(Some(Duration::from_secs(10))).expect("a limit");
    stream
}

/// Sends until the other side closes the connection, at most `most` bytes.
fn flood(stream: &mut TcpStream, piece: &[u8], most: usize) -> usize {
    let mut sent = 0;
    while sent < most && stream.write_all(piece).is_ok() {
        sent += piece.len();
    }
    sent
}

fn first_line(stream: &mut TcpStream) -> String {
    let mut line = String::new();
    // A closed connection is an answer too.
    let _read = BufReader::new(stream).read_line(&mut line);
    line.trim().to_string()
}

#[test]
fn the_web_server_survives_whoever_connects() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut view = Command::new(PROGRAM)
        .args(["view", "--web"])
        .arg(sample())
        .env("TMPDIR", folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("runs");
    let mut address = String::new();
    BufReader::new(view.stdout.take().expect("piped")).read_line(&mut address).expect("an address");
    let port: u16 = address.split("127.0.0.1:").nth(1).and_then(|a| a.split('/').next()?.parse().ok()).expect("a port");
    let good = || {
        let started = Instant::now();
        let mut stream = connect(port);
        write!(stream, "GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n").expect("sent");
        assert!(first_line(&mut stream).contains("200"), "a right request is answered");
        assert!(started.elapsed() < super::LONGEST);
    };
    good();
    let before_kb = memory_kb(&view);
    for (request, code) in [
        (format!("POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 10000000000000\r\n\r\nabc"), "405"),
        (
            format!(
                "POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n"
            ),
            "40",
        ),
        ("GET / HTTP/1.1\r\nHost: evil.com\r\n\r\n".into(), "403"),
        ("GET / HTTP/1.1\r\n\r\n".into(), "40"),
        (format!("GET /recording.rrd HTTP/1.1\r\nHost: evil.com:{port}\r\n\r\n"), "403"),
        ("\x16\x03\x01\x02\x00\x01\x00\x01\r\n\r\n".into(), "400"),
    ] {
        let mut stream = connect(port);
        stream.write_all(request.as_bytes()).expect("sent");
        let line = first_line(&mut stream);
        assert!(line.is_empty() || line.contains(code), "{request:?}: {line}");
        good();
    }
    // A head that never ends.
    let mut stream = connect(port);
    stream.write_all(b"GET / HTTP/1.1\r\nX: ").expect("sent");
    let sent = flood(&mut stream, &[b'a'; 65_536], 64 << 20);
    assert!(sent < 64 << 20, "{sent} bytes of a head were taken");
    good();
    // Many requests at once whose answers are not read; many connections that send nothing.
    let mut stream = connect(port);
    let request = format!("GET /re_viewer.js HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n").repeat(200);
    stream.set_write_timeout(Some(Duration::from_millis(300))).expect("a limit");
    flood(&mut stream, request.as_bytes(), 20_000 * 60);
    good();
    let idle: Vec<TcpStream> = (0..300).map(|_| connect(port)).collect();
    good();
    drop(idle);
    if cfg!(target_os = "linux") {
        let grown_kb = memory_kb(&view) - before_kb;
        let threads = std::fs::read_dir(format!("/proc/{}/task", view.id())).expect("threads").count();
        println!("{grown_kb} kB more at most, {threads} threads");
        assert!(threads < 16, "{threads} threads");
        assert!(grown_kb < 100_000, "{grown_kb} kB");
    }
    let told = Command::new("kill").args(["-INT", &view.id().to_string()]).status();
    assert!(told.expect("told").success());
    assert_eq!(view.wait().expect("ends").code(), Some(130));
}

/// A live run, its port, its token, and its later output.
fn live(duration: &str) -> (Child, u16, String, JoinHandle<String>) {
    let mut run = Command::new(PROGRAM)
        .args([
            "run",
            "bush-20-40",
            "--no-output",
            "--duration",
            duration,
            "--live",
            "foxglove=0",
            "--live-wait",
            "60s",
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("runs");
    let mut said = String::new();
    let mut lines = BufReader::new(run.stderr.take().expect("piped"));
    while !said.contains("ws://") {
        assert!(lines.read_line(&mut said).expect("text") > 0, "{said}");
    }
    let address = said.split("ws://127.0.0.1:").nth(1).expect("an address");
    let (port, token) = address.split_once('/').expect("a token");
    let token: String = token.chars().take_while(char::is_ascii_hexdigit).collect();
    let port = port.parse().expect("a port");
    let rest = std::thread::spawn(move || {
        let mut rest = String::new();
        lines.read_to_string(&mut rest).expect("text");
        rest
    });
    (run, port, token, rest)
}

/// Performs the handshake; returns the stream and the first line of the answer.
fn greet(port: u16, path: &str, headers: &str) -> (TcpStream, String) {
    let mut stream = connect(port);
    let request = format!(
        "GET /{path} HTTP/1.1\r\n{headers}Upgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Key: cGl0Y2hsaW5lcGl0Y2hsaQ==\r\nSec-WebSocket-Version: 13\r\n\
         Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    );
    let _sent = stream.write_all(request.as_bytes());
    let line = first_line(&mut stream);
    (stream, line)
}

/// A frame of a client, masked with zeros.
fn frame(kind: u8, content: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x80 | kind, 0x80 | 127];
    frame.extend((content.len() as u64).to_be_bytes());
    frame.extend([0; 4]);
    frame.extend(content);
    frame
}

fn subscribe_to_all() -> Vec<u8> {
    let wishes: Vec<_> = (1..10).map(|id| serde_json::json!({ "id": id, "channelId": id })).collect();
    frame(1, serde_json::json!({ "op": "subscribe", "subscriptions": wishes }).to_string().as_bytes())
}

#[test]
fn a_live_run_lets_in_whom_it_knows() {
    let (mut run, port, token, _) = live("1ms");
    let host = format!("Host: 127.0.0.1:{port}\r\n");
    let half = token[..16].to_string();
    for (path, headers) in [
        ("", host.clone()),
        (half.as_str(), host.clone()),
        ("0123456789abcdef0123456789abcdef", host.clone()),
        ("", format!("{host}Origin: http://evil.com\r\n")),
        ("", format!("{host}Origin: null\r\n")),
        (token.as_str(), format!("Host: evil.com:{port}\r\n")),
        (token.as_str(), String::new()),
    ] {
        let (_, line) = greet(port, path, &headers);
        assert!(line.contains("403"), "{path} {headers}: {line}");
    }
    let (mut stream, line) = greet(port, &token, &format!("{host}Origin: https://app.foxglove.dev\r\n"));
    assert!(line.contains("101"), "{line}");
    stream.write_all(&subscribe_to_all()).expect("sent");
    assert!(run.wait().expect("ends").success());
}

#[test]
fn a_live_run_ends_in_its_own_time_whoever_connects() {
    let (mut run, port, token, said) = live("1s");
    let host = format!("Host: 127.0.0.1:{port}\r\n");
    let mut clients = Vec::new();
    for _ in 0..60 {
        let (mut stream, line) = greet(port, &token, &host);
        if line.contains("101") {
            // Subscribes to everything and never reads.
            stream.write_all(&subscribe_to_all()).expect("sent");
            clients.push(stream);
        }
    }
    let started = Instant::now();
    assert!((1..=8).contains(&clients.len()), "{} clients", clients.len());
    // A client that sends invalid data is disconnected, and the others are not affected.
    let mut rude = clients.pop().expect("a client");
    let _sent = rude.write_all(&frame(2, &vec![0; 1 << 20]));
    let mut lying = clients.pop().expect("a client");
    let _sent = lying.write_all(&[0x82, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    let mut chatty = clients.pop().expect("a client");
    let _sent = flood(&mut chatty, &frame(1, b"{\"op\":\"nonsense\"}").repeat(100), 1 << 20);
    let mut broken = clients.pop().expect("a client");
    let _sent = broken.write_all(&frame(1, &[0xff, 0xfe, 0xfd]));
    for _ in 0..40 {
        let mut stream = connect(port);
        let _sent = stream.write_all(b"\x00\xffnot a handshake");
        let _closed = stream.shutdown(Shutdown::Write);
    }
    let mut peak_kb = 0;
    let status = loop {
        peak_kb = peak_kb.max(memory_kb(&run));
        if let Some(status) = run.try_wait().expect("lives") {
            break status;
        }
        assert!(started.elapsed() < Duration::from_secs(60), "the run hangs");
        std::thread::sleep(Duration::from_millis(10));
    };
    let took = started.elapsed();
    let said = said.join().expect("read");
    println!("{took:?}, {peak_kb} kB: {said}");
    assert!(status.success(), "{said}");
    // A second of this drive takes 0.6 to 2 s here; at the end the run waits for at most the two seconds of the closing
    // handshake.
    assert!(took < Duration::from_secs(30) && peak_kb < 300_000, "{took:?}, {peak_kb} kB");
    assert!(said.contains("messages left out") && said.contains("refused"), "{said}");
}

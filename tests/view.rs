//! `pitchline view`: served content, started programs, remaining files.

#[allow(dead_code)]
#[path = "common/readers.rs"]
mod readers;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn pitchline() -> Command {
    Command::new(env!("CARGO_BIN_EXE_pitchline"))
}

fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/samples/bush-20-40.mcap")
}

#[test]
fn what_is_no_recording_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("notes.mcap");
    std::fs::write(&text, "no such thing").expect("writable");
    let missing = folder.path().join("missing.rrd");
    for (path, says) in
        [(text.as_path(), "is no recording"), (missing.as_path(), "cannot read"), (folder.path(), "is a directory")]
    {
        let out = pitchline().arg("view").arg(path).output().expect("runs");
        assert_eq!(out.status.code(), Some(2), "{}", stderr(&out));
        assert!(stderr(&out).contains(says), "{}", stderr(&out));
    }
}

#[cfg(not(feature = "rerun"))]
#[test]
fn a_program_without_the_viewer_says_what_to_build() {
    let out = pitchline().arg("view").arg(sample()).env("PITCHLINE_RERUN", "no-such-program").output().expect("runs");
    assert_eq!(out.status.code(), Some(2));
    assert!(stderr(&out).contains("pip install rerun-sdk") && stderr(&out).contains("--features"), "{}", stderr(&out));
}

#[cfg(feature = "rerun")]
#[test]
fn an_archive_converts_to_what_the_run_would_have_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let run = pitchline()
        .args(["run", "bush-20-40", "--duration", "12ms", "-o"])
        .arg(at("a.mcap"))
        .arg("-o")
        .arg(at("a.rrd"))
        .output();
    assert!(run.expect("runs").status.success());
    let out = pitchline().arg("view").arg(at("a.mcap")).arg("-o").arg(at("b.rrd")).output().expect("runs");
    assert!(out.status.success(), "{}", stderr(&out));
    let refused = pitchline().arg("view").arg(at("a.rrd")).arg("-o").arg(at("c.rrd")).output().expect("runs");
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    let Some(program) = readers::rerun() else { return };
    let compared =
        Command::new(&program).args(["rrd", "compare", "--unordered"]).arg(at("a.rrd")).arg(at("b.rrd")).output();
    let compared = compared.expect("ran before");
    assert!(compared.status.success(), "the two differ");
}

/// A viewer that only reports that it was started.
#[cfg(all(unix, feature = "rerun"))]
fn fake_viewer(folder: &Path, version: &str, then: &str) -> PathBuf {
    let path = folder.join(format!("rerun-{version}"));
    let script = format!(
        "#!/bin/sh\nif [ \"$1\" = --version ]; then echo \"rerun-cli {version} (none)\"; exit; fi\necho \"shows $@\"\n{then}\n"
    );
    std::fs::write(&path, script).expect("writable");
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("executable");
    path
}

#[cfg(all(unix, feature = "rerun"))]
#[test]
fn the_installed_viewer_gets_the_recording_and_nothing_is_left_behind() {
    let folder = tempfile::tempdir().expect("a folder");
    let temporary = folder.path().join("tmp");
    std::fs::create_dir(&temporary).expect("a folder");
    let view = |viewer: PathBuf| {
        let mut command = pitchline();
        command.arg("view").arg(sample()).env("PITCHLINE_RERUN", viewer);
        command.env("DISPLAY", ":0").env("TMPDIR", &temporary).output().expect("runs")
    };
    let out = view(fake_viewer(folder.path(), "0.36.3", "ls -l \"$1\""));
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(out.status.success() && said.contains("bush-20-40.rrd --bind 127.0.0.1"), "{said}{}", stderr(&out));
    let out = view(fake_viewer(folder.path(), "0.36.4", "exit 3"));
    assert_eq!(out.status.code(), Some(1), "{}", stderr(&out));
    assert_eq!(std::fs::read_dir(&temporary).expect("a folder").count(), 0);
}

#[cfg(all(unix, feature = "web"))]
mod web {
    use super::{pitchline, sample};
    use std::io::{BufRead, BufReader, Read, Write};
    use std::net::TcpStream;
    use std::path::Path;
    use std::process::{Child, Command, Stdio};
    use std::time::Duration;

    /// Runs `pitchline view --web`; returns the process and the host that it prints.
    fn serve(recording: &Path, temporary: &Path) -> (Child, String, String) {
        let mut command = pitchline();
        command.arg("view").arg("--web").arg(recording).env("TMPDIR", temporary);
        let mut view = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("runs");
        let mut address = String::new();
        BufReader::new(view.stdout.take().expect("piped")).read_line(&mut address).expect("an address");
        let host = address.trim_start_matches("http://").split('/').next().unwrap_or_default().to_string();
        (view, address.trim().to_string(), host)
    }

    /// First line, headers and body of an answer.
    fn get(host: &str, named: &str, path: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(host).expect("somebody listens");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a limit");
        let request = format!("GET {path} HTTP/1.1\r\nHost: {named}\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).expect("sent");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n").expect("headers");
        (String::from_utf8_lossy(&answer[..end]).into_owned(), answer.split_off(end + 4))
    }

    #[test]
    fn the_web_viewer_is_served_with_its_recording_to_this_machine_only() {
        let folder = tempfile::tempdir().expect("a folder");
        let (mut view, address, host) = serve(&sample(), folder.path());
        assert!(
            host.starts_with("127.0.0.1:") && address.contains(&format!("?url=http://{host}/recording.rrd")),
            "{address}"
        );
        let files = [
            ("/", "text/html", 10_000, &b"<!"[..]),
            ("/index.html?url=x", "text/html", 10_000, b"<!"),
            ("/re_viewer.js", "text/javascript", 100_000, b""),
            ("/re_viewer_bg.wasm", "application/wasm", 20_000_000, b"\0asm"),
            ("/recording.rrd", "application/octet-stream", 100_000, b"RRF2"),
        ];
        for (path, mime, least_bytes, first) in files {
            let (head, body) = get(&host, &host, path);
            println!("{path}: {} bytes", body.len());
            assert!(head.starts_with("HTTP/1.1 200") && head.contains(mime), "{path}: {head}");
            assert!(head.contains(&format!("Content-Length: {}", body.len())), "{path}: {head}");
            assert!(body.len() > least_bytes && body.starts_with(first), "{path}");
            assert!(!head.to_lowercase().contains("access-control"), "other pages may not read it: {head}");
        }
        let (local, _) = get(&host, &host.replace("127.0.0.1", "localhost"), "/");
        assert!(local.starts_with("HTTP/1.1 200"), "{local}");
        for (named, path, code) in [(host.as_str(), "/../Cargo.toml", "404"), ("elsewhere.example", "/", "403")] {
            let (head, _) = get(&host, named, path);
            assert!(head.starts_with(&format!("HTTP/1.1 {code}")), "{named} {path}: {head}");
        }
        let left = || std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(left(), 1, "the converted recording");
        let told = Command::new("kill").args(["-INT", &view.id().to_string()]).status();
        assert!(told.expect("told").success());
        assert_eq!(view.wait().expect("ends").code(), Some(130));
        assert_eq!(left(), 0);
    }
}

//! The Rerun viewer for web browsers, served from this program together with one recording. Only this machine is answered:
//! the server listens on the loopback address, and asks that the browser means it by that name, so that no web page from
//! elsewhere can read the recording. Page and recording have one origin, hence need no CORS headers and give no one else leave.

use super::{Failure, Outcome, print_out};
use re_web_viewer_server::WebViewerData;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response, Server, StatusCode};

/// Where the recording is, whatever its file is called.
const RECORDING: &str = "/recording.rrd";

struct Site {
    /// `127.0.0.1:PORT`.
    host: String,
    viewer: WebViewerData,
    recording: PathBuf,
}

/// Serves the viewer and `recording` until `stop`.
pub fn serve(recording: &Path, port: u16, open: bool, stop: &AtomicBool) -> Result<Outcome, Failure> {
    let viewer = WebViewerData::load(None).map_err(|e| Failure::World(format!("no web viewer: {e}")))?;
    let server = Server::http(("127.0.0.1", port))
        .map_err(|e| Failure::World(format!("cannot listen at 127.0.0.1:{port}: {e}")))?;
    let host = server.server_addr().to_string();
    let address = format!("http://{host}/?url=http://{host}{RECORDING}&hide_welcome_screen=1");
    let site = Arc::new(Site { host, viewer, recording: recording.to_path_buf() });
    eprintln!("open this address in a web browser; Ctrl-C ends it:");
    print_out(&format!("{address}\n"))?;
    if open {
        start_browser(&address);
    }
    while !stop.load(Ordering::Relaxed) {
        let request = server.recv_timeout(Duration::from_millis(100));
        if let Some(request) = request.map_err(|e| Failure::World(format!("the web server failed: {e}")))? {
            let site = Arc::clone(&site);
            // A browser asks for several things at once, and may take its time. One that goes away is no failure.
            std::thread::spawn(move || {
                let _sent = answer(request, &site);
            });
        }
    }
    Ok(Outcome::Interrupted)
}

fn answer(request: Request, site: &Site) -> std::io::Result<()> {
    let named = |host: &str| host == site.host || host.strip_prefix("localhost") == site.host.strip_prefix("127.0.0.1");
    let host = request.headers().iter().find(|header| header.field.equiv("Host")).map(|header| header.value.as_str());
    if !host.is_some_and(named) {
        return request.respond(Response::empty(StatusCode(403)));
    }
    if !matches!(request.method(), Method::Get | Method::Head) {
        return request.respond(Response::empty(StatusCode(405)));
    }
    let viewer = &site.viewer;
    let (mime, bytes) = match request.url().split('?').next().unwrap_or_default() {
        RECORDING => {
            let Ok(file) = File::open(&site.recording) else {
                return request.respond(Response::empty(StatusCode(404)));
            };
            let length = file.metadata()?.len();
            return respond(request, "application/octet-stream", file, usize::try_from(length).ok());
        }
        "/" | "/index.html" => ("text/html", viewer.index_html()),
        "/re_viewer.js" => ("text/javascript", viewer.viewer_js()),
        "/re_viewer_bg.wasm" => ("application/wasm", viewer.viewer_wasm()),
        "/sw.js" => ("text/javascript", viewer.sw_js()),
        "/favicon.ico" => ("image/x-icon", viewer.favicon()),
        "/apple-touch-icon.png" => ("image/png", viewer.apple_touch_icon()),
        _ => return request.respond(Response::empty(StatusCode(404))),
    };
    respond(request, mime, bytes, Some(bytes.len()))
}

fn respond(request: Request, mime: &str, body: impl Read, length: Option<usize>) -> std::io::Result<()> {
    // The next recording has the same address.
    let headers = [("Content-Type", mime), ("Cache-Control", "no-store"), ("X-Content-Type-Options", "nosniff")];
    let headers = headers.iter().filter_map(|(name, value)| Header::from_bytes(*name, *value).ok()).collect();
    // Never in chunks: the page shows its progress by the length.
    request.respond(Response::new(StatusCode(200), headers, body, length, None).with_chunked_threshold(usize::MAX))
}

/// By the means of the desktop; where there is none the address has been printed.
fn start_browser(address: &str) {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    if let Err(e) = Command::new(program).arg(address).spawn() {
        eprintln!("warning: cannot start a web browser with `{program}`: {e}");
    }
}

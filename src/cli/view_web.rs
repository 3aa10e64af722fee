//! Serves the Rerun web viewer from this program together with one recording. Only this machine has access: the server
//! listens on the loopback address and requires that the browser addresses it by a loopback name, so that no foreign
//! web page can read the recording. Page and recording have one origin, so that no CORS headers are needed and no other
//! origin gets access.

use super::{Failure, Outcome, print_out};
use crate::local_server::http::{Site, accept};
use re_web_viewer_server::WebViewerData;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::TcpListener;

/// Path of the recording on the server, independent of its file name.
const RECORDING: &str = "/recording.rrd";

/// Serves the viewer and `recording` until `stop`.
pub fn serve(recording: &Path, port: u16, open: bool, stop: &AtomicBool) -> Result<Outcome, Failure> {
    let viewer = WebViewerData::load(None).map_err(|e| Failure::World(format!("no web viewer: {e}")))?;
    // It is served until the program ends.
    let viewer: &'static WebViewerData = Box::leak(Box::new(viewer));
    let pages = vec![
        ("/", "text/html", viewer.index_html()),
        ("/index.html", "text/html", viewer.index_html()),
        ("/re_viewer.js", "text/javascript", viewer.viewer_js()),
        ("/re_viewer_bg.wasm", "application/wasm", viewer.viewer_wasm()),
        ("/sw.js", "text/javascript", viewer.sw_js()),
        ("/favicon.ico", "image/x-icon", viewer.favicon()),
        ("/apple-touch-icon.png", "image/png", viewer.apple_touch_icon()),
    ];
    let failed = |e: std::io::Error| Failure::World(format!("cannot listen at 127.0.0.1:{port}: {e}"));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build().map_err(failed)?;
    let listener =
        runtime.block_on(TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port)))).map_err(failed)?;
    let host = listener.local_addr().map_err(failed)?;
    let address = format!("http://{host}/?url=http://{host}{RECORDING}&hide_welcome_screen=1");
    let site = Site { port: host.port(), pages, recording: (RECORDING, recording.to_path_buf()) };
    eprintln!("open this address in a web browser; Ctrl-C ends it:");
    print_out(&format!("{address}\n"))?;
    if open {
        start_browser(&address);
    }
    let stopped = async {
        while !stop.load(Ordering::Relaxed) {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    runtime.block_on(async {
        tokio::select! {
            () = accept(listener, Arc::new(site)) => {}
            () = stopped => {}
        }
    });
    runtime.shutdown_background();
    Ok(Outcome::Interrupted)
}

/// Starts the desktop's browser. If there is none, the address has already been printed.
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

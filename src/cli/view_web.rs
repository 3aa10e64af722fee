//! The Rerun viewer for web browsers, served from this program together with one recording. Only this machine is answered:
//! the server listens on the loopback address, and asks that the browser means it by that name, so that no web page from
//! elsewhere can read the recording. Page and recording have one origin, hence need no CORS headers and give no one else leave.
//!
//! Whoever asks costs a bounded amount of memory: heads of requests have a longest length and a longest time, bodies are never
//! read, files are sent piece by piece, and where too many connections are open the oldest goes.

use super::{Failure, Outcome, print_out};
use crate::local_server::is_named;
use hyper::body::{Body, Bytes, Frame, Incoming, SizeHint};
use hyper::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE, HOST, HeaderValue, X_CONTENT_TYPE_OPTIONS};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use re_web_viewer_server::WebViewerData;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::fs::File;
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::AbortHandle;

/// Where the recording is, whatever its file is called.
const RECORDING: &str = "/recording.rrd";
/// Connections at one time; a browser opens six.
const MOST_CONNECTIONS: usize = 32;
/// Longest head of a request [bytes], most headers in it, and how long it may take.
const LONGEST_HEAD: usize = 32 << 10;
const MOST_HEADERS: usize = 64;
const HEAD_TIME: Duration = Duration::from_secs(20);
/// Bytes of a file that are in memory for one connection.
const PIECE: u64 = 256 << 10;

struct Site {
    port: u16,
    /// Until the program ends.
    viewer: &'static WebViewerData,
    recording: PathBuf,
}

/// Serves the viewer and `recording` until `stop`.
pub fn serve(recording: &Path, port: u16, open: bool, stop: &AtomicBool) -> Result<Outcome, Failure> {
    let viewer = WebViewerData::load(None).map_err(|e| Failure::World(format!("no web viewer: {e}")))?;
    let failed = |e: std::io::Error| Failure::World(format!("cannot listen at 127.0.0.1:{port}: {e}"));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build().map_err(failed)?;
    let listener =
        runtime.block_on(TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port)))).map_err(failed)?;
    let host = listener.local_addr().map_err(failed)?;
    let address = format!("http://{host}/?url=http://{host}{RECORDING}&hide_welcome_screen=1");
    let site = Site { port: host.port(), viewer: Box::leak(Box::new(viewer)), recording: recording.to_path_buf() };
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

async fn accept(listener: TcpListener, site: Arc<Site>) {
    let mut connections: VecDeque<AbortHandle> = VecDeque::new();
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Out of descriptors, as a rule: some will be free again.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        connections.retain(|connection| !connection.is_finished());
        while connections.len() >= MOST_CONNECTIONS {
            if let Some(oldest) = connections.pop_front() {
                oldest.abort();
            }
        }
        let site = Arc::clone(&site);
        let talk = tokio::spawn(async move {
            let answers = service_fn(move |request| {
                let response = answer(&request, &site);
                async move { Ok::<_, Infallible>(response) }
            });
            let mut http = http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).title_case_headers(true);
            http.max_buf_size(LONGEST_HEAD).max_headers(MOST_HEADERS);
            // A browser that goes away is no failure.
            let _ended = http.serve_connection(TokioIo::new(stream), answers).await;
        });
        connections.push_back(talk.abort_handle());
    }
}

fn answer(request: &Request<Incoming>, site: &Site) -> Response<Piecewise> {
    let host = request.headers().get(HOST).and_then(|host| host.to_str().ok());
    if !is_named(host, site.port) {
        return empty(StatusCode::FORBIDDEN);
    }
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        return empty(StatusCode::METHOD_NOT_ALLOWED);
    }
    let viewer = site.viewer;
    let (mime, bytes) = match request.uri().path() {
        RECORDING => {
            let file = File::open(&site.recording).and_then(|file| Ok((file.metadata()?.len(), file)));
            return match file {
                Ok((left, file)) => found("application/octet-stream", Piecewise::File { file, left }),
                Err(_) => empty(StatusCode::NOT_FOUND),
            };
        }
        "/" | "/index.html" => ("text/html", viewer.index_html()),
        "/re_viewer.js" => ("text/javascript", viewer.viewer_js()),
        "/re_viewer_bg.wasm" => ("application/wasm", viewer.viewer_wasm()),
        "/sw.js" => ("text/javascript", viewer.sw_js()),
        "/favicon.ico" => ("image/x-icon", viewer.favicon()),
        "/apple-touch-icon.png" => ("image/png", viewer.apple_touch_icon()),
        _ => return empty(StatusCode::NOT_FOUND),
    };
    found(mime, Piecewise::Bytes(bytes))
}

fn empty(status: StatusCode) -> Response<Piecewise> {
    let mut response = Response::new(Piecewise::Bytes(&[]));
    *response.status_mut() = status;
    response
}

/// Never in chunks: the page shows its progress by the length. Never from a cache: the next recording has the same address.
fn found(mime: &'static str, body: Piecewise) -> Response<Piecewise> {
    let length = body.left();
    let mut response = Response::new(body);
    let headers = response.headers_mut();
    headers.insert(CONTENT_LENGTH, HeaderValue::from(length));
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(mime));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    response
}

/// What is sent, a piece at a time.
enum Piecewise {
    Bytes(&'static [u8]),
    File { file: File, left: u64 },
}

impl Piecewise {
    fn left(&self) -> u64 {
        match self {
            Piecewise::Bytes(bytes) => bytes.len() as u64,
            Piecewise::File { left, .. } => *left,
        }
    }
}

impl Body for Piecewise {
    type Data = Bytes;
    type Error = std::io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<std::io::Result<Frame<Bytes>>>> {
        if self.left() == 0 {
            return Poll::Ready(None);
        }
        Poll::Ready(Some(match &mut *self {
            Piecewise::Bytes(bytes) => Ok(Frame::data(Bytes::from_static(std::mem::take(bytes)))),
            Piecewise::File { file, left } => {
                let mut piece = Vec::new();
                match file.take(PIECE.min(*left)).read_to_end(&mut piece) {
                    // It has become shorter: the connection ends, and the browser knows by the length.
                    Ok(0) => Err(std::io::ErrorKind::UnexpectedEof.into()),
                    Ok(read) => {
                        *left -= read as u64;
                        Ok(Frame::data(Bytes::from(piece)))
                    }
                    Err(e) => Err(e),
                }
            }
        }))
    }

    fn is_end_stream(&self) -> bool {
        self.left() == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left())
    }
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

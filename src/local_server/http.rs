//! An HTTP server for a few files and one recording. Each client uses a bounded amount of memory: request heads have a
//! maximum length and duration, bodies are never read, files are sent in pieces, and if too many connections are open
//! the oldest is closed.
#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

use super::is_named;
use hyper::body::{Body, Bytes, Frame, Incoming, SizeHint};
use hyper::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE, HOST, HeaderValue, X_CONTENT_TYPE_OPTIONS};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::fs::File;
use std::io::Read;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::task::AbortHandle;

/// Maximum number of connections; a browser opens six.
const MAX_CONNECTIONS: usize = 32;
/// Longest head of a request [bytes], maximum number of headers, and maximum duration.
const LONGEST_HEAD: usize = 32 << 10;
const MAX_HEADERS: usize = 64;
const HEAD_TIME: Duration = Duration::from_secs(20);
/// Bytes of a file in memory for one connection.
const PIECE: u64 = 256 << 10;

/// Content to be served.
pub struct Site {
    /// The port on which the server listens; requests must name it.
    pub port: u16,
    /// Paths, content types and contents that live until the program ends.
    pub pages: Vec<(&'static str, &'static str, &'static [u8])>,
    /// A path and its file, which is opened for every request.
    pub recording: (&'static str, PathBuf),
}

/// Accepts connections until it is dropped.
pub async fn accept(listener: TcpListener, site: Arc<Site>) {
    let mut connections: VecDeque<AbortHandle> = VecDeque::new();
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Usually out of file descriptors; some will be released.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        connections.retain(|connection| !connection.is_finished());
        while connections.len() >= MAX_CONNECTIONS {
            if let Some(oldest) = connections.pop_front() {
                oldest.abort();
            }
        }
        let connection = tokio::spawn(serve_connection(stream, Arc::clone(&site)));
        connections.push_back(connection.abort_handle());
    }
}

/// Serves one connection until either side closes it.
pub async fn serve_connection<S: AsyncRead + AsyncWrite + Unpin>(stream: S, site: Arc<Site>) {
    let answers = service_fn(move |request| {
        let response = answer(&request, &site);
        async move { Ok::<_, Infallible>(response) }
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).title_case_headers(true);
    http.max_buf_size(LONGEST_HEAD).max_headers(MAX_HEADERS);
    // A browser that disconnects is not a failure.
    let _ended = http.serve_connection(TokioIo::new(stream), answers).await;
}

fn answer(request: &Request<Incoming>, site: &Site) -> Response<PiecewiseBody> {
    let host = request.headers().get(HOST).and_then(|host| host.to_str().ok());
    if !is_named(host, site.port) {
        return empty_response(StatusCode::FORBIDDEN);
    }
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        return empty_response(StatusCode::METHOD_NOT_ALLOWED);
    }
    let wanted = request.uri().path();
    if let Some((_, mime, bytes)) = site.pages.iter().find(|(path, ..)| *path == wanted) {
        return content_response(mime, PiecewiseBody::Bytes(bytes));
    }
    let (path, recording) = &site.recording;
    let file = (*path == wanted).then(|| File::open(recording).and_then(|file| Ok((file.metadata()?.len(), file))));
    match file {
        Some(Ok((left, file))) => content_response("application/octet-stream", PiecewiseBody::File { file, left }),
        Some(Err(_)) | None => empty_response(StatusCode::NOT_FOUND),
    }
}

fn empty_response(status: StatusCode) -> Response<PiecewiseBody> {
    let mut response = Response::new(PiecewiseBody::Bytes(&[]));
    *response.status_mut() = status;
    response
}

/// Not chunked, because the page shows its progress by the length. Not cached, because the next recording has the same
/// address.
fn content_response(mime: &'static str, body: PiecewiseBody) -> Response<PiecewiseBody> {
    let length = body.remaining();
    let mut response = Response::new(body);
    let headers = response.headers_mut();
    headers.insert(CONTENT_LENGTH, HeaderValue::from(length));
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(mime));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    response
}

/// A response body that is sent in pieces.
enum PiecewiseBody {
    Bytes(&'static [u8]),
    File { file: File, left: u64 },
}

impl PiecewiseBody {
    fn remaining(&self) -> u64 {
        match self {
            PiecewiseBody::Bytes(bytes) => bytes.len() as u64,
            PiecewiseBody::File { left, .. } => *left,
        }
    }
}

impl Body for PiecewiseBody {
    type Data = Bytes;
    type Error = std::io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<std::io::Result<Frame<Bytes>>>> {
        if self.remaining() == 0 {
            return Poll::Ready(None);
        }
        Poll::Ready(Some(match &mut *self {
            PiecewiseBody::Bytes(bytes) => Ok(Frame::data(Bytes::from_static(std::mem::take(bytes)))),
            PiecewiseBody::File { file, left } => {
                let mut piece = Vec::new();
                match file.take(PIECE.min(*left)).read_to_end(&mut piece) {
                    // The file has become shorter: the connection ends, and the browser detects it by the length.
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
        self.remaining() == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.remaining())
    }
}

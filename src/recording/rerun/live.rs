//! Shows a run in a Rerun viewer while it computes: the rows of the `.rrd` over gRPC. The run waits for a slow viewer,
//! but at most for [`SEND_TIMEOUT`]; a viewer that has stopped reading is then dropped like one that has closed.

use super::{RerunSink, RowDestination, recording_id};
use crate::recording::frame::Header;
use crate::recording::{ViewOptions, live};
use anyhow::{Context, Result};
use rerun::RecordingStream;
use rerun::external::re_uri::{Origin, ProxyUri};
use rerun::sink::GrpcSink;
use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::mpsc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Time between two blocks: short enough not to appear delayed, long enough to limit the cost of messages.
pub const BLOCK_INTERVAL: Duration = Duration::from_millis(100);

/// Time limit of a viewer for reading a block.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

impl RerunSink {
    /// Shows the run to the viewer at `url`, e.g. `rerun+http://127.0.0.1:9876/proxy`; waits until it is available.
    pub fn connect(url: &str, header: &Header, view: ViewOptions, wait: Duration) -> Result<RerunSink> {
        let uri: ProxyUri = url.parse().with_context(|| format!("{url} is not the address of a Rerun viewer"))?;
        // The crate would try forever without reporting it.
        live::wait_for(wait, || reach(&uri.origin))
            .with_context(|| format!("no Rerun viewer at {url} (start one: rerun --bind 127.0.0.1)"))?;
        // Distinguishes two runs of one drive in one viewer.
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let recording = format!("{}-live-{}", recording_id(header), now.as_millis());
        let end = RowDestination::Viewer { last_block: Instant::now() };
        RerunSink::begin(PathBuf::from(url), end, Box::new(GrpcSink::new(uri)), recording, header, view)
            .with_context(|| format!("no Rerun viewer at {url}"))
    }
}

/// Whether a server listens there.
fn reach(origin: &Origin) -> Result<()> {
    let host = origin.host.to_string();
    TcpStream::connect((host.trim_matches(['[', ']']), origin.port))?;
    Ok(())
}

/// Waits until everything sent so far has been passed to the network.
pub fn flush(stream: &RecordingStream) -> Result<()> {
    Ok(stream.flush_with_timeout(SEND_TIMEOUT)?)
}

/// Ends the stream when everything has been read.
pub fn close(stream: Option<RecordingStream>) -> Result<()> {
    // Dropping the stream waits for the viewer indefinitely; it happens on a thread that is waited for only for a
    // limited time.
    let (done, ended) = mpsc::channel();
    std::thread::spawn(move || {
        drop(stream);
        // Fails if the receiver has stopped waiting.
        let _told = done.send(());
    });
    ended.recv_timeout(SEND_TIMEOUT).context("the viewer has stopped reading")
}

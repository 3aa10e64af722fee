//! A run shown in a Rerun viewer while it computes: the rows of the `.rrd` over gRPC. The run waits for a viewer that reads
//! slower than it computes, but only for [`PATIENCE`]: one that has stopped reading is given up like one that is gone.

use super::{End, RerunSink, recording_id};
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

/// Time between two blocks: below what an eye takes for a delay, above what messages cost.
pub const BLOCK_INTERVAL: Duration = Duration::from_millis(100);

/// How long a viewer may take to read a block.
const PATIENCE: Duration = Duration::from_secs(10);

impl RerunSink {
    /// Shows the run to the viewer at `url`, e.g. `rerun+http://127.0.0.1:9876/proxy`; waits for it to be there.
    pub fn connect(url: &str, header: &Header, view: ViewOptions, wait: Duration) -> Result<RerunSink> {
        let uri: ProxyUri = url.parse().with_context(|| format!("{url} is no address of a Rerun viewer"))?;
        // The crate would try for ever, and tell nobody why.
        live::wait_for(wait, || reach(&uri.origin))
            .with_context(|| format!("no Rerun viewer at {url} (start one: rerun --bind 127.0.0.1)"))?;
        // Two runs of one drive in one viewer stay apart.
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let recording = format!("{}-live-{}", recording_id(header), now.as_millis());
        let end = End::Viewer { last_block: Instant::now() };
        RerunSink::begin(PathBuf::from(url), end, Box::new(GrpcSink::new(uri)), recording, header, view)
            .with_context(|| format!("no Rerun viewer at {url}"))
    }
}

/// Whether somebody listens.
fn reach(origin: &Origin) -> Result<()> {
    let host = origin.host.to_string();
    TcpStream::connect((host.trim_matches(['[', ']']), origin.port))?;
    Ok(())
}

/// Waits until everything sent so far is on its way.
pub fn flush(stream: &RecordingStream) -> Result<()> {
    Ok(stream.flush_with_timeout(PATIENCE)?)
}

/// Ends the stream when all has been read.
pub fn close(stream: Option<RecordingStream>) -> Result<()> {
    // The stream waits for the viewer without end; nobody waits for this thread longer than that.
    let (done, ended) = mpsc::channel();
    std::thread::spawn(move || {
        drop(stream);
        // Nobody listens any more if it took too long.
        let _told = done.send(());
    });
    ended.recv_timeout(PATIENCE).context("the viewer has stopped reading")
}

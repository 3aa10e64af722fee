//! Any bytes from somebody who has connected to the web viewer's server: answers or an end, never a panic, never a hang.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run http -- -max_total_time=3600 -rss_limit_mb=1024
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::local_server::http::{Site, serve_connection};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

const LONGEST: Duration = Duration::from_secs(5);

fuzz_target!(|data: &[u8]| {
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_time().build() else { return };
    let pages = vec![("/", "text/html", &b"<!doctype html>"[..])];
    let site = Arc::new(Site { port: 80, pages, recording: ("/recording.rrd", "Cargo.toml".into()) });
    runtime.block_on(async {
        let (ours, theirs) = tokio::io::duplex(1 << 12);
        let talking = tokio::spawn(serve_connection(ours, site));
        let (mut from, mut to) = tokio::io::split(theirs);
        let reading = tokio::spawn(async move {
            let mut answers = Vec::new();
            let _ended = from.read_to_end(&mut answers).await;
            answers
        });
        let _sent = to.write_all(data).await;
        let _closed = to.shutdown().await;
        let ended = tokio::time::timeout(LONGEST, reading).await;
        assert!(ended.is_ok(), "the connection does not end");
        talking.await.expect("no panic");
    });
});

//! Any bytes from somebody who has connected to a live run: instead of the handshake where the first byte is even, behind a right one
//! where it is odd. An end, never a panic, never a hang.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run websocket -- -max_total_time=3600 -rss_limit_mb=1024
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::recording::foxglove_live::server::{Shared, accept_client};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

const LONGEST: Duration = Duration::from_secs(5);
const TOKEN: &str = "0123456789abcdef0123456789abcdef";

fuzz_target!(|data: &[u8]| {
    let Some((kind, said)) = data.split_first() else { return };
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_time().build() else { return };
    let at_start = vec![(0, Arc::from(&b"header"[..]))];
    let shared = Arc::new(Shared::new(80, TOKEN.into(), ["{}".into(), "{}".into()], at_start));
    let mut bytes = Vec::new();
    if kind % 2 == 1 {
        bytes.extend(
            format!(
                "GET /{TOKEN} HTTP/1.1\r\nHost: localhost:80\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: cGl0Y2hsaW5lcGl0Y2hsaQ==\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
            )
            .bytes(),
        );
    }
    bytes.extend(said);
    runtime.block_on(async {
        let (ours, theirs) = tokio::io::duplex(1 << 12);
        let talking = tokio::spawn(async move { accept_client(ours, &shared, ()).await });
        let (mut from, mut to) = tokio::io::split(theirs);
        let reading = tokio::spawn(async move {
            let mut answers = Vec::new();
            let _ended = from.read_to_end(&mut answers).await;
        });
        let _sent = to.write_all(&bytes).await;
        let _closed = to.shutdown().await;
        let ended = tokio::time::timeout(LONGEST, reading).await;
        assert!(ended.is_ok(), "the connection does not end");
        talking.await.expect("no panic");
    });
});

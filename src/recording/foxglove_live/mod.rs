//! Shows a run in the Foxglove app while it computes: the topics of the MCAP archive over a WebSocket, on this machine
//! only. Foxglove is the client: it connects to this server and may disconnect and return. It never delays the run: if
//! it reads too slowly, the oldest messages are dropped.

pub mod server;

use super::frame::{Event, Frame, Header, Impact, Keyframe, Signals};
use super::mcap::{
    DESCRIPTOR, DRIVE, EVENT, FRAME, HEADER, IMPACT, KEYFRAME, LOG, SCENE, SIGNALS, TOPICS, TRANSFORMS, nanoseconds,
};
use super::{PictureClock, Sink, ViewOptions, foxglove_scene as scene, live};
use crate::local_server::token;
use anyhow::Context as _;
use base64::Engine as _;
use prost::Message;
use server::{Counts, Server};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Minimum time between two updates of the app's clock.
const CLOCK_INTERVAL: Duration = Duration::from_millis(5);
/// Time at the end in which waiting messages may still be sent.
const LINGER: Duration = Duration::from_secs(2);

/// Serves a run to the Foxglove app.
pub struct FoxgloveSink {
    address: PathBuf,
    /// None once finished.
    server: Option<Server>,
    outlines: Vec<u8>,
    header: Header,
    clock: PictureClock,
    transforms: scene::Transforms,
    forces: scene::ForceArrows,
    buffer: Vec<u8>,
    last_clock: Option<Instant>,
    has_client: bool,
    say: fn(&str),
}

impl FoxgloveSink {
    /// Listens on `port` (0: any free port) and waits for a client that subscribes to something.
    pub fn serve(
        port: u16,
        header: &Header,
        view: ViewOptions,
        wait: Duration,
        say: fn(&str),
    ) -> anyhow::Result<FoxgloveSink> {
        let outlines = scene::outlines(header).encode_to_vec();
        let at_start = vec![(HEADER, header.encode_to_vec().into()), (DRIVE, outlines.as_slice().into())];
        let token = token()?;
        let server = Server::start(port, token.clone(), greeting(header), at_start)?;
        let address = format!("ws://127.0.0.1:{}/{token}", server.port());
        say(&format!("Foxglove: open the connection {address}; waiting for it for {:.0} s", wait.as_secs_f64()));
        live::wait_for(wait, || {
            anyhow::ensure!(server.was_subscribed(), "no client has subscribed to a topic");
            Ok(())
        })
        .with_context(|| format!("no Foxglove at {address}"))?;
        Ok(FoxgloveSink {
            address: PathBuf::from(address),
            server: Some(server),
            outlines,
            header: header.clone(),
            clock: PictureClock::new(view.picture_interval_s),
            transforms: scene::Transforms::new(header),
            forces: scene::ForceArrows::new(header),
            buffer: Vec::new(),
            last_clock: None,
            has_client: true,
            say,
        })
    }

    fn has_subscribers(&self, topic: usize) -> bool {
        self.server.as_ref().is_some_and(|server| server.has_subscribers(topic))
    }

    fn send(&mut self, topic: usize, t_ns: u64, message: &impl Message) {
        if self.has_subscribers(topic) {
            self.buffer.clear();
            message.encode_raw(&mut self.buffer);
            self.send_buffer(topic, t_ns);
        }
    }

    fn send_buffer(&self, topic: usize, t_ns: u64) {
        if let Some(server) = &self.server {
            server.send(topic, t_ns, &self.buffer);
        }
    }

    /// Sets the app's clock to simulated time, and checks whether a client is connected.
    fn keep_time(&mut self, t_ns: u64) {
        let Some(server) = &self.server else { return };
        if self.last_clock.is_some_and(|last| last.elapsed() < CLOCK_INTERVAL) {
            return;
        }
        self.last_clock = Some(Instant::now());
        server.set_clock(t_ns);
        let has_client = server.clients() > 0;
        if self.has_client && !has_client {
            let address = self.address.display();
            (self.say)(&format!(
                "warning: nobody watches at {address} any more; the run continues, Foxglove may reconnect"
            ));
        }
        self.has_client = has_client;
    }
}

/// The first texts of the protocol: the server's name, and one channel for each topic, numbered from 1 in the order of
/// [`TOPICS`].
fn greeting(header: &Header) -> [String; 2] {
    let channel = |(index, (topic, schema)): (usize, &(&str, &str))| {
        let data = scene::schema(schema).unwrap_or(Cow::Borrowed(DESCRIPTOR));
        serde_json::json!({
            "id": index + 1,
            "topic": topic,
            "encoding": "protobuf",
            "schemaName": schema,
            "schema": base64::engine::general_purpose::STANDARD.encode(data),
            "schemaEncoding": "protobuf",
        })
    };
    let channels: Vec<_> = TOPICS.iter().enumerate().map(channel).collect();
    let name = format!("pitchline: {}", header.drive_name);
    [
        serde_json::json!({ "op": "serverInfo", "name": name, "capabilities": ["time"] }).to_string(),
        serde_json::json!({ "op": "advertise", "channels": channels }).to_string(),
    ]
}

impl Sink for FoxgloveSink {
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let t_ns = nanoseconds(frame.t_s);
        self.keep_time(t_ns);
        self.send(FRAME, t_ns, frame);
        self.send(SIGNALS, t_ns, &Signals::of(frame, self.header.bodies.len()));
        if self.clock.due(frame.t_s) {
            if self.has_subscribers(TRANSFORMS) {
                self.buffer.clear();
                self.transforms.put_bytes(&self.header, frame, t_ns, &mut self.buffer);
                self.send_buffer(TRANSFORMS, t_ns);
            }
            self.send(SCENE, t_ns, &self.forces.of(&self.header, frame, t_ns));
        }
        Ok(())
    }

    fn keyframe(&mut self, keyframe: &Keyframe) -> anyhow::Result<()> {
        let t_ns = nanoseconds(keyframe.step as f64 * self.header.step_s);
        self.send(KEYFRAME, t_ns, keyframe);
        // A client that was too slow may have lost its outlines.
        if let Some(server) = self.server.as_ref().filter(|server| server.has_subscribers(DRIVE)) {
            server.send(DRIVE, t_ns, &self.outlines);
        }
        Ok(())
    }

    fn event(&mut self, event: &Event) -> anyhow::Result<()> {
        let t_ns = nanoseconds(event.t_s);
        self.send(EVENT, t_ns, event);
        self.send(LOG, t_ns, &scene::log(event, t_ns));
        Ok(())
    }

    fn impact(&mut self, impact: &Impact) -> anyhow::Result<()> {
        self.send(IMPACT, nanoseconds(impact.t_s), impact);
        Ok(())
    }

    fn close(&mut self) -> anyhow::Result<u64> {
        if let Some(mut server) = self.server.take() {
            server.finish(LINGER);
            let Counts { clients, refused, closed, left_out } = server.counts();
            let count = |n: &AtomicU64| n.load(Ordering::Relaxed);
            let (clients, refused, closed, left_out) = (count(clients), count(refused), count(closed), count(left_out));
            if refused + closed + left_out > 0 {
                (self.say)(&format!(
                    "Foxglove: {clients} connections, {refused} more refused, {closed} closed because they stopped reading or \
                     sent invalid messages; {left_out} messages left out for slow readers"
                ));
            }
        }
        Ok(0)
    }

    fn path(&self) -> &Path {
        &self.address
    }
}

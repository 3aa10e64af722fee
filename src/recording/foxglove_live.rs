//! A run shown in the Foxglove app while it computes: the topics of the MCAP archive over a WebSocket, on this machine only.
//! Foxglove is the client: it comes to us, may be closed and come back. It never holds the run up: where it reads too slowly,
//! the oldest messages are left out.

use super::frame::{Event, Frame, Header, Impact, Keyframe, Signals};
use super::mcap::{
    DESCRIPTOR, EVENT, FRAME, HEADER, IMPACT, KEYFRAME, LOG, SCENE, SIGNALS, TOPICS, TRANSFORMS, nanoseconds,
};
use super::{PictureClock, Sink, ViewOptions, foxglove_scene as scene, live};
use anyhow::Context as _;
use foxglove::websocket::{Capability, ChannelView, Client, ServerListener};
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer, WebSocketServerHandle};
use prost::Message;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Messages that wait for a client before the oldest is left out; at 10 kB a frame some 40 MB.
const BACKLOG: usize = 4096;
/// Shortest time between two messages that set the app's clock: a client whose backlog is full of those is thrown out.
const CLOCK_INTERVAL: Duration = Duration::from_millis(5);
/// How long what is in the backlog gets to go out at the end: the server cannot be asked when it has gone.
const LINGER: Duration = Duration::from_millis(500);

/// Serves a run to the Foxglove app.
pub struct FoxgloveSink {
    address: PathBuf,
    /// None once finished.
    server: Option<WebSocketServerHandle>,
    /// Of the server; channels die with it.
    _context: Arc<Context>,
    greeter: Arc<Greeter>,
    header: Header,
    clock: PictureClock,
    transforms: scene::Transforms,
    buffer: Vec<u8>,
    last_clock: Option<Instant>,
    has_client: bool,
    say: fn(&str),
}

/// Gives a client that comes late what was sent once: the header and the outlines.
struct Greeter {
    channels: Vec<Arc<RawChannel>>,
    header: Vec<u8>,
    outlines: Vec<u8>,
    /// Whether anybody has subscribed to anything yet.
    subscribed: AtomicBool,
}

impl ServerListener for Greeter {
    fn on_subscribe(&self, client: Client, channel: ChannelView<'_>) {
        let once = [(HEADER, &self.header), (SCENE, &self.outlines)];
        for (index, message) in once.into_iter().filter(|(index, _)| TOPICS[*index].0 == channel.topic()) {
            let at_start = PartialMetadata::with_log_time(0_u64);
            self.channels[index].log_with_meta_to_sink(message, at_start, client.sink_id());
        }
        self.subscribed.store(true, Ordering::Relaxed);
    }
}

impl FoxgloveSink {
    /// Listens at `port` (0: any that is free) and waits for a client that subscribes to something.
    pub fn serve(
        port: u16,
        header: &Header,
        view: ViewOptions,
        wait: Duration,
        say: fn(&str),
    ) -> anyhow::Result<FoxgloveSink> {
        let context = Context::new();
        let greeter = Arc::new(Greeter {
            channels: channels(&context)?,
            header: header.encode_to_vec(),
            outlines: scene::outlines(header).encode_to_vec(),
            subscribed: AtomicBool::new(false),
        });
        let server = WebSocketServer::new()
            .name(format!("pitchline: {}", header.drive_name))
            .bind("127.0.0.1", port)
            .context(&context)
            .capabilities([Capability::Time])
            .message_backlog_size(BACKLOG)
            .listener(Arc::clone(&greeter) as Arc<dyn ServerListener>)
            .start_blocking()
            .with_context(|| format!("cannot listen at ws://127.0.0.1:{port}"))?;
        let address = format!("ws://127.0.0.1:{}", server.port());
        say(&format!("Foxglove: open the connection {address}; waiting for it for {:.0} s", wait.as_secs_f64()));
        live::wait_for(wait, || {
            anyhow::ensure!(greeter.subscribed.load(Ordering::Relaxed), "nobody has subscribed to a topic");
            Ok(())
        })
        .with_context(|| format!("no Foxglove at {address}"))?;
        Ok(FoxgloveSink {
            address: PathBuf::from(address),
            server: Some(server),
            _context: context,
            greeter,
            header: header.clone(),
            clock: PictureClock::new(view),
            transforms: scene::Transforms::new(header),
            buffer: Vec::new(),
            last_clock: None,
            has_client: true,
            say,
        })
    }

    fn send(&mut self, channel: usize, t_ns: u64, message: &impl Message) {
        if self.greeter.channels[channel].has_sinks() {
            self.buffer.clear();
            message.encode_raw(&mut self.buffer);
            self.send_buffer(channel, t_ns);
        }
    }

    fn send_buffer(&self, channel: usize, t_ns: u64) {
        self.greeter.channels[channel].log_with_meta(&self.buffer, PartialMetadata::with_log_time(t_ns));
    }

    /// Sets the app's clock to simulated time, and looks whether anybody is there.
    fn keep_time(&mut self, t_ns: u64) {
        let Some(server) = &self.server else { return };
        if self.last_clock.is_some_and(|last| last.elapsed() < CLOCK_INTERVAL) {
            return;
        }
        self.last_clock = Some(Instant::now());
        server.broadcast_time(t_ns);
        let has_client = server.client_count() > 0;
        if self.has_client && !has_client {
            let address = self.address.display();
            (self.say)(&format!(
                "warning: nobody watches at {address} any more; the run goes on, Foxglove may come back"
            ));
        }
        self.has_client = has_client;
    }
}

/// One channel for each topic, in the order of [`TOPICS`].
fn channels(context: &Arc<Context>) -> anyhow::Result<Vec<Arc<RawChannel>>> {
    let channel = |(topic, schema): &(&str, &str)| {
        let data = scene::schema(schema).unwrap_or(Cow::Borrowed(DESCRIPTOR));
        let schema = Schema::new(*schema, "protobuf", data);
        Ok(ChannelBuilder::new(*topic).message_encoding("protobuf").schema(schema).context(context).build_raw()?)
    };
    TOPICS.iter().map(channel).collect()
}

impl Sink for FoxgloveSink {
    fn frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let t_ns = nanoseconds(frame.t_s);
        self.keep_time(t_ns);
        self.send(FRAME, t_ns, frame);
        self.send(SIGNALS, t_ns, &Signals::of(frame, self.header.bodies.len()));
        if self.clock.due(frame.t_s) {
            if self.greeter.channels[TRANSFORMS].has_sinks() {
                self.buffer.clear();
                self.transforms.put_bytes(&self.header, frame, t_ns, &mut self.buffer);
                self.send_buffer(TRANSFORMS, t_ns);
            }
            self.send(SCENE, t_ns, &scene::forces(&self.header, frame, t_ns));
        }
        Ok(())
    }

    fn keyframe(&mut self, keyframe: &Keyframe) -> anyhow::Result<()> {
        let t_ns = nanoseconds(keyframe.step as f64 * self.header.step_s);
        self.send(KEYFRAME, t_ns, keyframe);
        // A client that was too slow may have lost its outlines.
        let outlines = PartialMetadata::with_log_time(t_ns);
        self.greeter.channels[SCENE].log_with_meta(&self.greeter.outlines, outlines);
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

    fn finish(&mut self) -> anyhow::Result<u64> {
        if let Some(server) = self.server.take() {
            if server.client_count() > 0 {
                std::thread::sleep(LINGER);
            }
            server.stop().wait_blocking();
        }
        Ok(0)
    }

    fn path(&self) -> &Path {
        &self.address
    }
}

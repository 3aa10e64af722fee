//! The WebSocket server of a live run: Foxglove's protocol (`foxglove.sdk.v1`) on its own thread. Each client uses a
//! bounded amount of memory and never delays the run:
//!
//! * a client has a queue of at most [`LARGEST_QUEUE`] bytes; if it reads too slowly, its oldest messages are dropped;
//! * a client that has read nothing for [`MESSAGE_TIMEOUT`], or sends more than a viewer needs to, is disconnected;
//! * there are at most [`MAX_CLIENTS`] clients, and [`MAX_HANDSHAKES`] more connections before their handshake.
//!
//! All dropped messages and closed connections are counted ([`Counts`]).

#![warn(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::cast_possible_truncation)]

use crate::local_server::{has_token, is_named};
use crate::recording::mcap::TOPICS;
use anyhow::{Context, Result};
use futures_util::{SinkExt, StreamExt};
use std::collections::VecDeque;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::{Notify, Semaphore, SemaphorePermit};
use tokio::task::AbortHandle;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::{HeaderValue, StatusCode, header};
use tokio_tungstenite::tungstenite::protocol::{Message, WebSocketConfig};

/// Maximum number of clients.
pub const MAX_CLIENTS: usize = 8;
/// Maximum number of connections before their handshake; the oldest is closed to make room.
const MAX_HANDSHAKES: usize = 32;
/// Bytes that may wait for a client before its oldest message is dropped: some 700 frames.
const LARGEST_QUEUE: usize = 8 << 20;
/// Time limit of a client for one message, and for its handshake.
const MESSAGE_TIMEOUT: Duration = Duration::from_secs(10);
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest message from a client: subscriptions to all topics take 1 kB.
const LONGEST_FROM_CLIENT: usize = 16 << 10;
/// Maximum number of messages from a client per second.
const MAX_MESSAGES_PER_S: u32 = 200;
/// Subprotocol of Foxglove's SDK; clients that offer none of its names are refused.
const SUBPROTOCOL: &str = "foxglove.sdk.v1";
/// First bytes of binary messages to the client.
const MESSAGE_DATA: u8 = 1;
const TIME: u8 = 2;

/// Counters for the summary at the end of the run.
#[derive(Debug, Default)]
pub struct Counts {
    /// Clients that connected, were refused at the handshake or because there were too many, and were disconnected for
    /// misbehaviour.
    pub clients: AtomicU64,
    pub refused: AtomicU64,
    pub closed: AtomicU64,
    pub left_out: AtomicU64,
}

/// A message for one client, or for all: its bytes are shared.
#[derive(Clone)]
struct Queued {
    /// Channel and log time; None for a text.
    head: Option<(usize, u64)>,
    content: Arc<[u8]>,
}

impl Queued {
    /// Memory of the message while it waits, including its place in the queue [bytes].
    fn size(&self) -> usize {
        self.content.len() + size_of::<Queued>()
    }
}

/// Messages that wait for a client.
#[derive(Default)]
struct Queue {
    messages: VecDeque<Queued>,
    bytes: usize,
    /// Time for the app's clock [ns]; only the newest value is kept.
    clock_ns: Option<u64>,
    ends: bool,
}

/// A client as seen by the run.
struct Client {
    queue: Mutex<Queue>,
    /// Signals that something was put into the queue.
    wake: Notify,
    /// Subscription number that the client gave to each topic.
    subscriptions: Mutex<[Option<u32>; TOPICS.len()]>,
}

/// Data shared by all threads.
pub struct Shared {
    port: u16,
    token: String,
    /// First texts for a client: the server's name, and the channels.
    greeting: [String; 2],
    /// Topics whose message a client gets when it subscribes.
    at_start: Vec<(usize, Arc<[u8]>)>,
    clients: Mutex<Vec<Arc<Client>>>,
    /// Number of subscribers of each topic.
    subscribers: [AtomicUsize; TOPICS.len()],
    subscribed: AtomicU64,
    client_slots: Semaphore,
    counts: Counts,
}

/// A server that runs until it is dropped.
pub struct Server {
    shared: Arc<Shared>,
    stop: Arc<Notify>,
    thread: Option<JoinHandle<()>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Server {
    /// Listens on `port` of the loopback address (0: any free port). `greeting` are the first texts of the protocol,
    /// `at_start` topics with the message that a new subscriber gets first.
    pub fn start(port: u16, token: String, greeting: [String; 2], at_start: Vec<(usize, Arc<[u8]>)>) -> Result<Server> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        let listener = runtime
            .block_on(TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port))))
            .with_context(|| format!("cannot listen at ws://127.0.0.1:{port}"))?;
        let shared = Arc::new(Shared::new(listener.local_addr()?.port(), token, greeting, at_start));
        let stop = Arc::new(Notify::new());
        let (ours, ends) = (Arc::clone(&shared), Arc::clone(&stop));
        let thread = std::thread::Builder::new().name("foxglove".into()).spawn(move || {
            runtime.block_on(async {
                tokio::select! {
                    () = accept(listener, ours) => {}
                    () = ends.notified() => {}
                }
            });
            // Tasks are cancelled immediately; no client is waited for.
            runtime.shutdown_background();
        })?;
        Ok(Server { shared, stop, thread: Some(thread) })
    }

    pub fn port(&self) -> u16 {
        self.shared.port
    }

    pub fn counts(&self) -> &Counts {
        &self.shared.counts
    }

    pub fn clients(&self) -> usize {
        locked(&self.shared.clients).len()
    }

    /// Whether any client has ever subscribed to anything.
    pub fn was_subscribed(&self) -> bool {
        self.shared.subscribed.load(Ordering::Relaxed) > 0
    }

    pub fn has_subscribers(&self, topic: usize) -> bool {
        self.shared.subscribers.get(topic).is_some_and(|n| n.load(Ordering::Relaxed) > 0)
    }

    /// Puts a message into the queues of its subscribers.
    pub fn send(&self, topic: usize, t_ns: u64, content: &[u8]) {
        let queued = Queued { head: Some((topic, t_ns)), content: content.into() };
        for client in locked(&self.shared.clients).iter() {
            if client.subscription(topic).is_some() {
                client.put(queued.clone(), &self.shared.counts);
            }
        }
    }

    /// Sets the clocks of all clients.
    pub fn set_clock(&self, t_ns: u64) {
        for client in locked(&self.shared.clients).iter() {
            locked(&client.queue).clock_ns = Some(t_ns);
            client.wake.notify_one();
        }
    }

    /// Sends waiting messages for at most `linger`, and closes the connections.
    pub fn finish(&mut self, linger: Duration) {
        let started = std::time::Instant::now();
        for client in locked(&self.shared.clients).iter() {
            locked(&client.queue).ends = true;
            client.wake.notify_one();
        }
        while self.clients() > 0 && started.elapsed() < linger {
            std::thread::sleep(Duration::from_millis(5));
        }
        self.end();
    }

    fn end(&mut self) {
        self.stop.notify_one();
        if let Some(thread) = self.thread.take() {
            // A server that panicked has already reported it.
            let _ended = thread.join();
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

impl Shared {
    pub fn new(port: u16, token: String, greeting: [String; 2], at_start: Vec<(usize, Arc<[u8]>)>) -> Shared {
        Shared {
            port,
            token,
            greeting,
            at_start,
            clients: Mutex::default(),
            subscribers: Default::default(),
            subscribed: AtomicU64::new(0),
            client_slots: Semaphore::new(MAX_CLIENTS),
            counts: Counts::default(),
        }
    }
}

impl Client {
    fn subscription(&self, topic: usize) -> Option<u32> {
        locked(&self.subscriptions).get(topic).copied().flatten()
    }

    /// Appends a message; the oldest ones are dropped to make room.
    fn put(&self, message: Queued, counts: &Counts) {
        let mut queue = locked(&self.queue);
        queue.bytes += message.size();
        queue.messages.push_back(message);
        while queue.bytes > LARGEST_QUEUE {
            let Some(oldest) = queue.messages.pop_front() else { break };
            queue.bytes -= oldest.size();
            counts.left_out.fetch_add(1, Ordering::Relaxed);
        }
        drop(queue);
        self.wake.notify_one();
    }

    /// The next message in wire format; None if nothing waits. The flag is set when no more messages will come.
    fn next(&self) -> (Option<Message>, bool) {
        let mut queue = locked(&self.queue);
        if let Some(t_ns) = queue.clock_ns.take() {
            let mut bytes = vec![TIME];
            bytes.extend(t_ns.to_le_bytes());
            return (Some(Message::binary(bytes)), false);
        }
        while let Some(queued) = queue.messages.pop_front() {
            queue.bytes -= queued.size();
            let Queued { head, content } = queued;
            let Some((topic, t_ns)) = head else {
                return (Some(Message::text(String::from_utf8_lossy(&content).into_owned())), false);
            };
            // It may have unsubscribed meanwhile.
            if let Some(id) = self.subscription(topic) {
                let mut bytes = Vec::with_capacity(13 + content.len());
                bytes.push(MESSAGE_DATA);
                bytes.extend(id.to_le_bytes());
                bytes.extend(t_ns.to_le_bytes());
                bytes.extend_from_slice(&content);
                return (Some(Message::binary(bytes)), false);
            }
        }
        (None, queue.ends)
    }
}

async fn accept(listener: TcpListener, shared: Arc<Shared>) {
    let mut handshakes: VecDeque<(AbortHandle, Arc<AtomicBool>)> = VecDeque::new();
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Usually out of file descriptors; some will be released.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        handshakes.retain(|(task, in_handshake)| in_handshake.load(Ordering::Relaxed) && !task.is_finished());
        // The oldest connection without a handshake is closed to make room.
        while handshakes.len() >= MAX_HANDSHAKES {
            if let Some((oldest, _)) = handshakes.pop_front() {
                oldest.abort();
                shared.counts.refused.fetch_add(1, Ordering::Relaxed);
            }
        }
        let in_handshake = Arc::new(AtomicBool::new(true));
        let guard = HandshakeGuard(Arc::clone(&in_handshake));
        let shared = Arc::clone(&shared);
        // Sends small messages without delay where the system supports it.
        let _set = stream.set_nodelay(true);
        let task = tokio::spawn(async move { accept_client(stream, &shared, guard).await });
        handshakes.push_back((task.abort_handle(), in_handshake));
    }
}

/// Signals on drop that a handshake is over.
struct HandshakeGuard(Arc<AtomicBool>);

impl Drop for HandshakeGuard {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Performs the handshake with a new connection and serves it if it is accepted. `guard` is dropped after the handshake.
pub async fn accept_client<S: AsyncRead + AsyncWrite + Unpin, D>(stream: S, shared: &Shared, guard: D) {
    let mut seat = None;
    let outcome = tokio::time::timeout(HANDSHAKE_TIMEOUT, handshake(stream, shared, &mut seat)).await;
    drop(guard);
    match outcome {
        Ok(Ok(socket)) => serve(socket, shared).await,
        Ok(Err(_)) | Err(_) => {
            shared.counts.refused.fetch_add(1, Ordering::Relaxed);
        }
    }
    drop(seat);
}

// The size of the error is the crate's.
#[allow(clippy::result_large_err)]
async fn handshake<'a, S: AsyncRead + AsyncWrite + Unpin>(
    stream: S,
    shared: &'a Shared,
    seat: &mut Option<SemaphorePermit<'a>>,
) -> Result<WebSocketStream<S>> {
    let config = WebSocketConfig::default()
        .read_buffer_size(16 << 10)
        .write_buffer_size(64 << 10)
        .max_write_buffer_size(LARGEST_QUEUE)
        .max_message_size(Some(LONGEST_FROM_CLIENT))
        .max_frame_size(Some(LONGEST_FROM_CLIENT));
    let refuse = |status: StatusCode, why: &str| {
        let mut response = ErrorResponse::new(Some(why.to_string()));
        *response.status_mut() = status;
        response
    };
    let check = |request: &Request, mut response: Response| {
        let text = |name: header::HeaderName| request.headers().get(name).map(|v| v.to_str().unwrap_or("?"));
        if !is_named(text(header::HOST), shared.port) {
            return Err(refuse(StatusCode::FORBIDDEN, "this server answers only to its own name"));
        }
        if !has_token(request.uri().path(), &shared.token) {
            return Err(refuse(StatusCode::FORBIDDEN, "use the whole address that pitchline has printed"));
        }
        let offered = request.headers().get_all(header::SEC_WEBSOCKET_PROTOCOL).iter();
        let mut offered = offered.filter_map(|v| v.to_str().ok()).flat_map(|v| v.split(','));
        if !offered.any(|name| name.trim() == SUBPROTOCOL) {
            return Err(refuse(StatusCode::BAD_REQUEST, "this server speaks foxglove.sdk.v1"));
        }
        // Only accepted clients take a seat.
        *seat = shared.client_slots.try_acquire().ok();
        if seat.is_none() {
            return Err(refuse(StatusCode::SERVICE_UNAVAILABLE, "too many viewers"));
        }
        response.headers_mut().insert(header::SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(SUBPROTOCOL));
        Ok(response)
    };
    Ok(tokio_tungstenite::accept_hdr_async_with_config(stream, check, Some(config)).await?)
}

/// Serves one client until either side closes the connection.
async fn serve<S: AsyncRead + AsyncWrite + Unpin>(socket: WebSocketStream<S>, shared: &Shared) {
    let client = Arc::new(Client {
        queue: Mutex::default(),
        wake: Notify::new(),
        subscriptions: Mutex::new(Default::default()),
    });
    for text in &shared.greeting {
        client.put(Queued { head: None, content: text.as_bytes().into() }, &shared.counts);
    }
    locked(&shared.clients).push(Arc::clone(&client));
    shared.counts.clients.fetch_add(1, Ordering::Relaxed);
    let (mut to_client, mut from_client) = socket.split();
    let writing = async {
        loop {
            let (message, ends) = client.next();
            match message {
                Some(message) => match tokio::time::timeout(MESSAGE_TIMEOUT, to_client.send(message)).await {
                    Ok(Ok(())) => {}
                    Ok(Err(_)) => return false,
                    Err(_) => return true,
                },
                None if ends => {
                    let _said = tokio::time::timeout(MESSAGE_TIMEOUT, to_client.close()).await;
                    return false;
                }
                None => client.wake.notified().await,
            }
        }
    };
    let reading = async {
        let (mut since, mut messages) = (tokio::time::Instant::now(), 0);
        while let Some(message) = from_client.next().await {
            if since.elapsed() > Duration::from_secs(1) {
                (since, messages) = (tokio::time::Instant::now(), 0);
            }
            messages += 1;
            match message {
                _ if messages > MAX_MESSAGES_PER_S => return true,
                Ok(Message::Text(text)) => listen(text.as_str(), &client, shared),
                Ok(Message::Close(_)) => return false,
                Ok(_) => {}
                Err(e) => return !matches!(e, Gone::ConnectionClosed | Gone::Io(_)),
            }
        }
        false
    };
    let thrown_out = tokio::select! {
        thrown_out = writing => thrown_out,
        thrown_out = reading => thrown_out,
    };
    shared.counts.closed.fetch_add(u64::from(thrown_out), Ordering::Relaxed);
    locked(&shared.clients).retain(|other| !Arc::ptr_eq(other, &client));
    for (count, id) in shared.subscribers.iter().zip(locked(&client.subscriptions).iter()) {
        if id.is_some() {
            count.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

use tokio_tungstenite::tungstenite::Error as Gone;

/// Handles a request of a client. Unknown requests are ignored.
fn listen(text: &str, client: &Client, shared: &Shared) {
    let Ok(said) = serde_json::from_str::<serde_json::Value>(text) else { return };
    let list = |key: &str| said.get(key).and_then(|list| list.as_array()).cloned().unwrap_or_default();
    // Channels are numbered from 1.
    let number = |value: &serde_json::Value| value.as_u64().and_then(|n| u32::try_from(n).ok());
    let field = |value: &serde_json::Value, key: &str| value.get(key).and_then(number);
    let mut subscriptions = locked(&client.subscriptions);
    match said.get("op").and_then(|op| op.as_str()) {
        Some("subscribe") => {
            for wish in list("subscriptions") {
                let topic = field(&wish, "channelId").and_then(|n| n.checked_sub(1)).map(|n| n as usize);
                let (Some(id), Some(topic)) = (field(&wish, "id"), topic) else { continue };
                let (Some(slot), Some(count)) = (subscriptions.get_mut(topic), shared.subscribers.get(topic)) else {
                    continue;
                };
                if slot.replace(id).is_some() {
                    continue;
                }
                count.fetch_add(1, Ordering::Relaxed);
                for (_, message) in shared.at_start.iter().filter(|(of, _)| *of == topic) {
                    client.put(Queued { head: Some((topic, 0)), content: Arc::clone(message) }, &shared.counts);
                }
                shared.subscribed.fetch_add(1, Ordering::Relaxed);
            }
        }
        Some("unsubscribe") => {
            for id in list("subscriptionIds").iter().filter_map(number) {
                let all = subscriptions.iter_mut().zip(&shared.subscribers);
                for (slot, count) in all.filter(|(slot, _)| **slot == Some(id)) {
                    *slot = None;
                    count.fetch_sub(1, Ordering::Relaxed);
                }
            }
        }
        _ => {}
    }
}

"""Hostile and useless clients of the two servers: the web viewer's and the one that shows a run while it computes."""

import base64
import contextlib
import json
import os
import random
import re
import signal
import socket
import struct
import threading
import time
from urllib.parse import urlsplit

from harness import CRASH_WORDS, Case, Running

HEALTH_LIMIT_S = 10.0
HTTP_GROWTH_MB = 300.0
HTTP_THREADS = 100
HTTP_ATTACKS_PER_CASE = 12
LIVE_GROWTH_MB = 200.0
LIVE_LIMIT_S = 30.0
LIVE_ARGUMENTS = ["run", "bush-20-40", "--duration", "2s", "--no-output", "--live-wait", "20s"]
PROTOCOLS = "foxglove.sdk.v1, foxglove.websocket.v1"

_undisturbed: list[tuple[float, float]] = []  # seconds and MB of a run with one honest client


class Address:
    """Where a server listens, as it printed it."""

    def __init__(self, url: str):
        parts = urlsplit(url)
        self.port = parts.port
        self.host = parts.netloc
        self.target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        self.has_token = self.target != "/"

    def connect(self, timeout: float = 5.0) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout)


def _printed_address(running: Running, scheme: str) -> Address | None:
    """The address that the program prints, or None where it ends before."""
    for _ in range(200):
        found = re.search(rf"{scheme}://[^\s;,]+:\d+[^\s;,]*", running.stdout_so_far() + running.stderr_so_far())
        if found:
            return Address(found.group())
        if running.wait(0.05):
            return None
    return None


def _answer(connection: socket.socket, limit: int = 4096) -> bytes:
    """What comes until the other side closes, falls silent, or has sent so much."""
    data = b""
    with contextlib.suppress(OSError):
        while len(data) < limit:
            more = connection.recv(65536)
            if not more:
                break
            data += more
    return data


def _status(answer: bytes) -> int:
    match = re.match(rb"HTTP/1\.[01] (\d{3})", answer)
    return int(match.group(1)) if match else 0


def _request(address: Address, method: str = "GET", target: str | None = None, host: str | None = None, more: str = "") -> bytes:
    return f"{method} {target or address.target} HTTP/1.1\r\nHost: {host or address.host}\r\n{more}\r\n".encode("utf-8", "surrogateescape")


# ---- the web viewer's server ----


def http(case: Case) -> None:
    case.write("x.mcap", case.world.recordings["bush"].read_bytes())
    running = case.start("view", "--web", "x.mcap")
    address = _printed_address(running, "http")
    if address is None:
        case.judge(running.finish(0.0))
        case.fail("printed no address")
        return
    if not _healthy(address):
        case.fail("does not answer an ordinary request")
    before = running.rss_mb()
    peak_mb, peak_threads = before, 0
    for attack in case.rng.sample(HTTP_ATTACKS, min(HTTP_ATTACKS_PER_CASE, len(HTTP_ATTACKS))):
        case.note(attack.__name__)
        with contextlib.ExitStack() as opened:
            with contextlib.suppress(OSError):
                complaint = attack(case.rng, address, opened)
                if complaint:
                    case.fail(complaint)
            if running.wait(0.0):
                case.fail("the server ended")
                break
            peak_mb, peak_threads = max(peak_mb, running.rss_mb()), max(peak_threads, running.threads())
            if not _healthy(address):
                case.fail("no answer to an ordinary request within 10 s while the attack's connections are open")
        if running.wait(0.0):
            case.fail("the server ended")
            break
        if not _healthy(address):
            case.fail("no answer to an ordinary request within 10 s after the attack's connections were closed")
            break
        if peak_mb - before > HTTP_GROWTH_MB:
            case.fail(f"grew from {before:.0f} to {peak_mb:.0f} MB")
            break
        if peak_threads > HTTP_THREADS:
            case.fail(f"{peak_threads} threads")
            break
    running.send(signal.SIGINT)
    ended = running.wait(5.0)
    result = running.finish(0.0 if not ended else time.monotonic() - running.began + 1.0)
    case.slowest_s = max(case.slowest_s, result.wall_s)
    case.largest_rss_mb = max(case.largest_rss_mb, result.rss_mb)
    if not ended:
        case.fail("does not end within 5 s of SIGINT")
    elif result.code not in (0, 130, -signal.SIGINT) or any(word in result.stderr for word in CRASH_WORDS):
        case.fail(f"ended with {result.code}: {result.stderr[-300:]}")


def _healthy(address: Address) -> bool:
    end = time.monotonic() + HEALTH_LIMIT_S
    while time.monotonic() < end:
        with contextlib.suppress(OSError), address.connect(end - time.monotonic()) as connection:
            connection.sendall(_request(address, more="Connection: close\r\n"))
            if _status(connection.recv(4096)) == 200:
                return True
        time.sleep(0.1)
    return False


def bad_methods(rng: random.Random, address: Address, opened) -> None:
    for method in ["PUT", "DELETE", "CONNECT", "TRACE", "get", "", " ", "é", "\0", "G" * 100_000, "GET\r\nGET", "OPTIONS", "PRI", "HEAD"]:
        with contextlib.suppress(OSError), address.connect(1.0) as connection:
            connection.sendall(_request(address, method, more="Connection: close\r\n"))
            connection.settimeout(0.2)
            _answer(connection)


def endless_bodies(rng: random.Random, address: Address, opened) -> None:
    for length in ["10995116277760", "18446744073709551615", "99999999999999999999999", "-1", "1e9", ""]:
        with contextlib.suppress(OSError):
            connection = opened.enter_context(address.connect(1.0))
            connection.sendall(_request(address, "POST", more=f"Content-Length: {length}\r\n"))
            for _ in range(20):
                connection.sendall(bytes(50_000))


def endless_headers(rng: random.Random, address: Address, opened) -> None:
    connection = opened.enter_context(address.connect(2.0))
    connection.sendall(_request(address)[:-2])
    line = rng.choice([b"X-Header: " + b"x" * 1000 + b"\r\n", b"x" * 10_000, b"A:b\r\n" * 1000, b"X: y\r\n z\r\n" * 100])
    for _ in range(20_000_000 // len(line)):
        connection.sendall(line)


def endless_request_line(rng: random.Random, address: Address, opened) -> None:
    connection = opened.enter_context(address.connect(2.0))
    connection.sendall(b"GET /")
    for _ in range(200):
        connection.sendall(b"a" * 100_000)


def pipelined(rng: random.Random, address: Address, opened) -> None:
    connection = opened.enter_context(address.connect(2.0))
    reads = rng.random() < 0.5
    reader = threading.Thread(target=_answer, args=(connection, 1 << 40), daemon=True)
    if reads:
        reader.start()
    one = _request(address, target=rng.choice(["/", "/nothing", "/recording.rrd"]))
    for _ in range(200):
        connection.sendall(one * 100)
    if reads:
        reader.join(8.0)


def slow_headers(rng: random.Random, address: Address, opened) -> None:
    connections = [opened.enter_context(address.connect(2.0)) for _ in range(50)]
    for byte in _request(address)[:15]:
        for connection in connections:
            with contextlib.suppress(OSError):
                connection.sendall(bytes([byte]))
        time.sleep(0.1)


def wrong_hosts(rng: random.Random, address: Address, opened) -> str | None:
    for host in ["evil.com", "evil.com:80", "127.0.0.1.evil.com", "localhost.evil.com", f"evil.com:{address.port}", f"0.0.0.0:{address.port}x"]:
        for target in [address.target, "/recording.rrd"]:
            with address.connect(2.0) as connection:
                connection.sendall(_request(address, target=target, host=host, more="Connection: close\r\n"))
                status = _status(_answer(connection, 100))
            if 200 <= status < 400:
                return f"answers {status} to a request for {target} of host {host}"
    return None


def huge_chunks(rng: random.Random, address: Address, opened) -> None:
    for size in ["ffffffffffffffff", "7fffffffffffffff", "fffffffffffffffff", "-1", "zz", "1000000"]:
        with contextlib.suppress(OSError):
            connection = opened.enter_context(address.connect(1.0))
            connection.sendall(_request(address, "POST", more="Transfer-Encoding: chunked\r\n") + size.encode() + b"\r\n")
            for _ in range(40):
                connection.sendall(bytes(100_000))


def garbage(rng: random.Random, address: Address, opened) -> None:
    for _ in range(50):
        with contextlib.suppress(OSError), address.connect(1.0) as connection:
            connection.sendall(rng.choice([rng.randbytes(500), bytes(1000), b"\r\n" * 500, b"\x16\x03\x01\x02\x00\x01" + rng.randbytes(200), b"GET / HTTP/9.9\r\n\r\n", b"GET\r\n\r\n"]))


def half_requests(rng: random.Random, address: Address, opened) -> None:
    whole = _request(address)
    for _ in range(100):
        connection = opened.enter_context(address.connect(2.0))
        connection.sendall(whole[: rng.randrange(1, len(whole))])


def many_connections(rng: random.Random, address: Address, opened) -> None:
    for _ in range(300):
        opened.enter_context(address.connect(2.0))


def answers_never_read(rng: random.Random, address: Address, opened) -> None:
    for _ in range(40):
        connection = opened.enter_context(address.connect(2.0))
        connection.sendall(_request(address, target=rng.choice(["/re_viewer_bg.wasm", "/recording.rrd", "/"])) * 3)


def paths(rng: random.Random, address: Address, opened) -> str | None:
    for target in ["/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/\0", "/" + "a/" * 5000, "http://evil.com/", "*", "/x.mcap", "/%", "/recording.rrd?" + "a" * 7000]:
        with contextlib.suppress(OSError), address.connect(2.0) as connection:
            connection.sendall(_request(address, target=target, more="Connection: close\r\nRange: bytes=0-99999999999999999999\r\n"))
            connection.settimeout(1.0)
            if b"root:" in _answer(connection):
                return f"sends a file outside of the viewer for {target}"
    return None


def odd_headers(rng: random.Random, address: Address, opened) -> None:
    for more in ["Expect: 100-continue\r\nContent-Length: 10\r\n", "Upgrade: websocket\r\nConnection: Upgrade\r\n", "Connection: \0\r\n", "Host: a\r\nHost: b\r\n", "Content-Length: 5\r\nContent-Length: 6\r\n",
                 "Transfer-Encoding: gzip\r\n", "Transfer-Encoding: chunked\r\nContent-Length: 3\r\n", ": empty\r\n", "no colon\r\n", "TE: chunked;q=nan\r\n", "Accept-Encoding: " + "a;q=1," * 1000 + "\r\n"]:  # fmt: skip
        with contextlib.suppress(OSError), address.connect(1.0) as connection:
            connection.sendall(_request(address, more=more) + b"abc")
            connection.settimeout(0.2)
            _answer(connection)


HTTP_ATTACKS = [
    bad_methods, endless_bodies, endless_headers, endless_request_line, pipelined, slow_headers, wrong_hosts, huge_chunks, garbage,
    half_requests, many_connections, answers_never_read, paths, odd_headers,
]  # fmt: skip


# ---- the server that shows a run while it computes ----


def websocket(case: Case) -> None:
    if not _undisturbed:
        _undisturbed.append(_live_run(case, []))
    usual_s, usual_mb = _undisturbed[0]
    chosen = case.rng.sample(LIVE_ATTACKS, case.rng.choice([1, 2, 3]))
    case.note(", ".join(attack.__name__ for attack in chosen))
    seconds, peak_mb = _live_run(case, chosen)
    if seconds > 3 * usual_s + 5:
        case.fail(f"took {seconds:.1f} s, undisturbed {usual_s:.1f} s")
    if peak_mb > usual_mb + LIVE_GROWTH_MB:
        case.fail(f"took {peak_mb:.0f} MB, undisturbed {usual_mb:.0f} MB")


def _live_run(case: Case, attacks: list) -> tuple[float, float]:
    """Seconds from the honest client's subscription to the end of the run, and the largest memory."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    running = case.start(*LIVE_ARGUMENTS, "--live", f"foxglove={port}")
    address = _printed_address(running, "ws")
    if address is None:
        case.fail("printed no address")
        case.judge(running.finish(0.0))
        return 0.0, 0.0
    if attacks:
        admitted = _admitted_strangers(address)
        if admitted:
            case.fail(f"let clients in that it has to refuse: {'; '.join(admitted)}")
    stop = threading.Event()
    threads = [threading.Thread(target=_until, args=(attack, random.Random(case.rng.random()), address, stop), daemon=True) for attack in attacks]
    for thread in threads:
        thread.start()
    time.sleep(0.5 if attacks else 0.0)
    began = time.monotonic()
    threads.append(threading.Thread(target=_honest_client, args=(address, stop), daemon=True))
    threads[-1].start()
    result = running.finish(LIVE_LIMIT_S)
    stop.set()
    for thread in threads:
        thread.join(5.0)
    case.slowest_s = max(case.slowest_s, result.wall_s)
    case.largest_rss_mb = max(case.largest_rss_mb, result.rss_mb)
    if result.code != 0 or any(word in result.stderr for word in CRASH_WORDS):
        case.fail(f"ended with {result.code}: {result.stderr[-300:]}")
    return time.monotonic() - began, result.rss_mb


def _until(attack, rng: random.Random, address: Address, stop: threading.Event) -> None:
    """Repeat an attack until the run has ended; its connections stay open as long."""
    with contextlib.ExitStack() as opened:
        while not stop.is_set():
            with contextlib.suppress(OSError):
                attack(rng, address, opened)
            stop.wait(0.2)
            if attack in ATTACKS_ONCE:
                stop.wait()


def _handshake(address: Address, origin: str | None = None, host: str | None = None, target: str | None = None, more: str = "") -> bytes:
    key = base64.b64encode(os.urandom(16)).decode()
    text = f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: {PROTOCOLS}\r\n"
    return _request(address, target=target, host=host, more=text + (f"Origin: {origin}\r\n" if origin else "") + more)


def _admitted_strangers(address: Address) -> list[str]:
    """Clients that have to be refused at the handshake, and were not."""
    without = {"target": "/"}
    strangers = {f"origin {origin}": {"origin": origin, **without} for origin in ("http://evil.com", "null", f"http://127.0.0.1.evil.com:{address.port}", "https://evil.com", "file://")}
    strangers |= {f"host {host}": {"host": host} for host in ("evil.com", f"evil.com:{address.port}")}
    if address.has_token:
        strangers |= {"no token": {"target": "/"}, "half the token": {"target": address.target[:-4]}, "a longer token": {"target": address.target + "a"}}
    admitted = []
    for name, how in strangers.items():
        with contextlib.suppress(OSError), address.connect(2.0) as connection:
            connection.sendall(_handshake(address, **how))
            status = _status(_answer(connection, 12))
            if status == 101 or 200 <= status < 400:
                admitted.append(f"{name} ({status})")
    return admitted


def _frame(opcode: int, payload: bytes, last: bool = True, masked: bool = True, length: int | None = None) -> bytes:
    stated = len(payload) if length is None else length
    head = bytes([opcode | (128 if last else 0)])
    bit = 128 if masked else 0
    if stated < 126:
        head += bytes([bit | stated])
    elif stated < 65536:
        head += bytes([bit | 126]) + struct.pack(">H", stated)
    else:
        head += bytes([bit | 127]) + struct.pack(">Q", stated)
    return head + (bytes(4) if masked else b"") + payload


def _open_websocket(address: Address) -> socket.socket:
    connection = address.connect()
    connection.sendall(_handshake(address))
    head = b""
    while b"\r\n\r\n" not in head:
        more = connection.recv(1)
        if not more:
            raise OSError("refused")
        head += more
    if _status(head) != 101:
        raise OSError(f"refused with {_status(head)}")
    return connection


def _read_exactly(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        more = connection.recv(count - len(data))
        if not more:
            raise OSError("closed")
        data += more
    return data


def _read_frame(connection: socket.socket) -> tuple[int, bytes]:
    first, second = _read_exactly(connection, 2)
    length = second & 127
    if length == 126:
        (length,) = struct.unpack(">H", _read_exactly(connection, 2))
    elif length == 127:
        (length,) = struct.unpack(">Q", _read_exactly(connection, 8))
    return first & 15, _read_exactly(connection, length)


def _subscribe(connection: socket.socket) -> None:
    """Wait for the channels, and ask for all of them."""
    while True:
        opcode, payload = _read_frame(connection)
        if opcode == 1 and (message := json.loads(payload)).get("op") == "advertise":
            break
    wanted = [{"id": i + 1, "channelId": channel["id"]} for i, channel in enumerate(message["channels"])]
    connection.sendall(_frame(1, json.dumps({"op": "subscribe", "subscriptions": wanted}).encode()))


def _honest_client(address: Address, stop: threading.Event) -> None:
    """Tries again where it is turned away, as a user would."""
    while not stop.is_set():
        with contextlib.suppress(OSError), _open_websocket(address) as connection:
            connection.settimeout(LIVE_LIMIT_S)
            _subscribe(connection)
            while _read_frame(connection)[0] != 8:
                pass
        stop.wait(0.5)


def subscribed_never_read(rng: random.Random, address: Address, opened) -> None:
    for _ in range(50):
        connection = opened.enter_context(_open_websocket(address))
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        _subscribe(connection)


def slow_readers(rng: random.Random, address: Address, opened) -> None:
    for _ in range(200):
        connection = opened.enter_context(_open_websocket(address))
        _subscribe(connection)
        connection.recv(10)


def idle_connections(rng: random.Random, address: Address, opened) -> None:
    for _ in range(200):
        opened.enter_context(address.connect())


def garbage_handshakes(rng: random.Random, address: Address, opened) -> None:
    for _ in range(20):
        with contextlib.suppress(OSError), address.connect() as connection:
            whole = _handshake(address)
            connection.sendall(
                rng.choice(
                    [rng.randbytes(1000), whole[: rng.randrange(len(whole))], whole.replace(b"13", b"99"), whole.replace(b"GET", b"POST"), _handshake(address, more="X: " + "y" * 200_000 + "\r\n"),
                     _handshake(address, more="X: y\r\n" * 5000), whole.replace(b"foxglove", b"other"), whole.replace(b"websocket", b"\0\xff")]
                )  # fmt: skip
            )
            connection.settimeout(0.1)
            _answer(connection)


def endless_handshake(rng: random.Random, address: Address, opened) -> None:
    connection = opened.enter_context(address.connect())
    connection.sendall(_handshake(address)[:-2])
    for _ in range(200):
        connection.sendall(b"X: " + b"y" * 100_000 + b"\r\n")


def hostile_frames(rng: random.Random, address: Address, opened) -> None:
    connection = opened.enter_context(_open_websocket(address))
    ops = ["subscribe", "unsubscribe", "advertise", "setParameters", "getParameters", "subscribeParameterUpdates", "fetchAsset", "playbackControlRequest", "no such op", "", 3, None]
    for _ in range(20):
        message = {"op": rng.choice(ops), "subscriptions": rng.choice([[], [{"id": -1, "channelId": 1 << 70}], "x", [{}] * 10_000]), "id": rng.choice([0, -1, "x"]), "uri": "file:///etc/passwd", "requestId": 1}
        frames = [
            _frame(1, json.dumps(message).encode()),
            _frame(2, rng.randbytes(rng.choice([0, 1, 5, 5000]))),
            _frame(1, b"\xff\xfe\xed\xa0\x80"),
            _frame(1, b"{" * rng.choice([1, 100_000])),
            _frame(1, b"[" * 200_000),
            _frame(1, b"{}", masked=False),
            _frame(2, b"x" * 1000, length=rng.choice([1 << 30, 1 << 40, (1 << 63) - 1, (1 << 64) - 1])),
            _frame(1, b"x" * 1_000_000, last=False),
            _frame(0, b"x" * 1_000_000, last=False) * 5,
            _frame(9, bytes(200)),
            _frame(9, b"ping") * 10_000,
            _frame(rng.choice([3, 7, 11, 15]), b"x"),
            _frame(8, rng.choice([b"", b"\0", b"\xff\xff\xff"])),
            rng.randbytes(2000),
        ]
        connection.sendall(rng.choice(frames))


def comings_and_goings(rng: random.Random, address: Address, opened) -> None:
    for _ in range(30):
        with contextlib.suppress(OSError), _open_websocket(address) as connection:
            if rng.random() < 0.5:
                _subscribe(connection)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


LIVE_ATTACKS = [subscribed_never_read, slow_readers, idle_connections, garbage_handshakes, endless_handshake, hostile_frames, comings_and_goings]
ATTACKS_ONCE = [subscribed_never_read, slow_readers, idle_connections]

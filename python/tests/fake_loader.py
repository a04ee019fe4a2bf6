"""A loader for tests: a server at a Unix socket that answers as a subclass says."""

import contextlib
import http.server
import json
import socketserver
import threading


class FakeLoader(socketserver.ThreadingUnixStreamServer):
    """Answers each connection in a thread of its own."""

    daemon_threads = True

    def __init__(self, path):
        super().__init__(str(path), _Handler)

    def answer(self, method, path, body):
        """The status and the body of an answer."""
        raise NotImplementedError

    def stream(self, request):
        """Answers `GET /stream`."""
        raise NotImplementedError

    def handle_error(self, *_):
        """Says nothing of a client that has gone before its answer."""

    @contextlib.contextmanager
    def serving(self):
        """Answers until the context ends."""
        thread = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.01})
        with self:
            thread.start()
            yield self
            self.shutdown()
            thread.join()


class _Handler(http.server.BaseHTTPRequestHandler):
    """One connection."""

    protocol_version = "HTTP/1.1"

    def do_POST(self):
        """Answers any method."""
        text = self.rfile.read(int(self.headers.get("content-length", 0)))
        body = json.loads(text) if text.startswith(b"{") else {}
        path = self.path.split("?")[0]
        if path == "/stream":
            self.server.stream(self)
            return
        status, answer = self.server.answer(self.command, path, body)
        sent = json.dumps(answer).encode()
        self.send_response(status)
        self.send_header("content-length", str(len(sent)))
        self.end_headers()
        self.wfile.write(sent)

    do_GET = do_DELETE = do_POST

    def log_message(self, *_):
        """Says nothing."""

    def address_string(self):
        """A Unix socket has no name."""
        return "local"

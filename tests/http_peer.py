"""A camera on loopback that sends what a scene shows, as a stream or for each request."""

from __future__ import annotations

import contextlib
import io
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
from PIL import Image


def jpeg(pixels, quality=100):
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, format="JPEG", quality=quality, subsampling=0)
    return out.getvalue()


class HttpPeer:
    """``pixels()`` gives the present frame; ``style`` is how they are sent.

    Styles: ``stream`` with lengths, ``bare`` a stream without, ``snapshot``, ``closing`` a snapshot
    that ends the connection, and ``text``, ``missing``, ``password`` for addresses that are none.
    """

    def __init__(self, pixels, style="stream", period_s=0.02, grey=True):
        self.pixels, self.style, self.period_s = pixels, style, period_s
        self.silent, self.cut = threading.Event(), threading.Event()
        self.damaged, self.asked, self.authorization = False, 0, None
        self.grey = grey
        peer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self):
                peer.asked += 1
                peer.authorization = self.headers.get("Authorization")
                peer.serve(self)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True)
        self.thread.start()
        self.port = self.server.server_address[1]
        self.address = f"http://127.0.0.1:{self.port}/video"

    def image(self):
        pixels = np.asarray(self.pixels(), np.uint8)
        data = jpeg(pixels if self.grey else np.repeat(pixels[..., None], 3, axis=2))
        return data[: len(data) // 2] if self.damaged else data

    def serve(self, handler):
        if self.style in ("snapshot", "closing"):
            while self.silent.is_set() and not self.cut.is_set():
                time.sleep(0.01)
            if self.cut.is_set():
                handler.close_connection = True
                return
            data = self.image()
            handler.send_response(200)
            handler.send_header("Content-Type", "image/jpeg")
            handler.send_header("Content-Length", str(len(data)))
            handler.end_headers()
            handler.wfile.write(data)
            handler.close_connection = self.style == "closing"
        elif self.style in ("stream", "bare"):
            self.stream(handler)
        else:
            status = {"text": 200, "missing": 404, "password": 401}[self.style]
            handler.send_response(status)
            handler.send_header("Content-Type", "text/html")
            handler.send_header("Content-Length", "2")
            handler.end_headers()
            handler.wfile.write(b"no")

    def stream(self, handler):
        handler.send_response(200)
        handler.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        handler.end_headers()
        handler.close_connection = True
        with contextlib.suppress(OSError):
            while not self.cut.is_set():
                if not self.silent.is_set():
                    data = self.image()
                    head = b"--frame\r\nContent-Type: image/jpeg\r\n"
                    if self.style == "stream":
                        head += f"Content-Length: {len(data)}\r\n".encode()
                    handler.wfile.write(head + b"\r\n" + data + b"\r\n")
                time.sleep(self.period_s)

    def stop(self):
        self.cut.set()
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()


@contextlib.contextmanager
def http_peer(pixels, style="stream", **options):
    peer = HttpPeer(pixels, style, **options)
    try:
        yield peer
    finally:
        peer.stop()

"""Errors of the transport."""

import socket
import threading

import pytest

import rcc


def test_a_loader_that_dies_in_mid_request_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv("RCC_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "gone").mkdir()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "gone/loader.sock"))
        listener.listen()
        dying = threading.Thread(target=lambda: listener.accept()[0].close())
        dying.start()
        with pytest.raises(rcc.RccError, match="gave no answer: GET /status"), rcc.connect("gone"):
            pass
        dying.join()

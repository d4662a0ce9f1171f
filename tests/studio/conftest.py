"""A studio in a folder of its own, and a page that knows its key."""

from __future__ import annotations

import asyncio
import hashlib
import io
import json
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

from lfportrait.studio.app import Keys, application
from lfportrait.studio.desk import Desk

PORT = 4711
HOME = f"http://127.0.0.1:{PORT}"


def run_apart(coroutine: Any) -> Any:
    """Run a coroutine in a thread of its own: a browser's loop may hold this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, coroutine).result()


class Page:
    """What the page in the browser is to the server."""

    def __init__(self, desk: Desk, client: TestClient, keys: Keys) -> None:
        self.desk, self.client, self.keys = desk, client, keys
        self.headers = {"origin": HOME, "x-lfportrait": "1"}

    def ask(self, method: str, path: str, data: Any = None, **more: Any) -> Any:
        """A request as the page sends it: JSON, or bytes."""
        headers = {**self.headers, **more.pop("headers", {})}
        if method != "GET":
            sent = data if isinstance(data, bytes) else json.dumps(data or {}).encode()
            kind = "application/octet-stream" if isinstance(data, bytes) else "application/json"
            more = {"content": sent, **more}
            headers.setdefault("content-type", kind)
        return self.client.request(method, path, headers=headers, **more)

    def get(self, path: str) -> Any:
        """What is read: JSON."""
        answer = self.ask("GET", path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def do(self, method: str, path: str, data: Any = None) -> Any:
        """What is done, and must succeed: JSON."""
        answer = self.ask(method, path, data)
        assert answer.status_code < 300, answer.text
        return answer.json()

    def error(self, method: str, path: str, data: Any = None) -> str:
        """The code of a refusal."""
        answer = self.ask(method, path, data)
        assert answer.status_code >= 400, answer.text
        return str(answer.json()["error"]["code"])

    def wait(self, job: str, state: str = "", seconds: float = 120.0) -> dict[str, Any]:
        """A job when it has ended, or reached a state."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            found: dict[str, Any] = self.get(f"/api/jobs/{job}")
            if found["state"] == state or found["state"] in ("done", "failed", "cancelled"):
                return found
            time.sleep(0.05)
        raise AssertionError(f"{job} is still {found['state']}: {found}")

    def send(self, project: str, name: str, data: bytes) -> dict[str, Any]:
        """Upload one photo."""
        entry = {"name": name, "size": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        found = self.do("POST", f"/api/projects/{project}/uploads", {"files": [entry]})["files"][0]
        if found["upload"] is not None:
            self.do("PUT", f"/api/projects/{project}/uploads/{found['upload']}"
                    f"?offset={found['offset']}", data[found["offset"]:])
        return dict(found)


def opened(folder: Path, **guard: Any) -> Iterator[Page]:
    desk, keys = Desk(folder), Keys(PORT)
    with TestClient(application(desk, keys, **guard), base_url=HOME) as client:
        page = Page(desk, client, keys)
        assert page.ask("POST", "/api/session", {"token": keys.token}).status_code == 200
        yield page


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    yield from opened(tmp_path / "portraits")


def jpeg(seed: int = 0, size: tuple[int, int] = (80, 60)) -> bytes:
    """A picture of noise as JPEG."""
    pixels = np.random.default_rng(seed).integers(0, 255, (size[1], size[0], 3), np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG")
    return buffer.getvalue()

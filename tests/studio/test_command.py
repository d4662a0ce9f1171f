"""The command: what it says where it can't begin, and its life from a terminal."""

import re
import shlex
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import lfportrait
from lfportrait.cli import main


def error_line(capsys):
    lines = [line for line in capsys.readouterr().err.splitlines()
             if line.startswith("lfportrait:")]
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize("name", ["starlette", "uvicorn"])
def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch, capsys, name):
    # What is imported below for a second time takes its place there, too.
    monkeypatch.setattr(lfportrait, "studio", sys.modules["lfportrait.studio"])
    for module in list(sys.modules):
        if module.startswith(("lfportrait.studio", f"{name}.")):
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    assert main(["studio", "--folder", str(tmp_path / "portraits"), "--no-browser"]) == 2
    assert error_line(capsys).endswith(f"needs {name}: pip install 'lfportrait[studio]'")
    assert not (tmp_path / "portraits").exists()


def test_a_port_that_is_taken_and_a_folder_that_is_none(tmp_path, capsys):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        assert main(["studio", "--folder", str(tmp_path), "--port", port]) == 2
        assert f"port {port}" in error_line(capsys)
    for port in ("-1", "99999"):
        assert main(["studio", "--folder", str(tmp_path), f"--port={port}"]) == 2
        assert "choose another --port" in error_line(capsys)
    (tmp_path / "file").write_text("")
    assert main(["studio", "--folder", str(tmp_path / "file")]) == 2
    assert "choose another folder" in error_line(capsys)


@pytest.mark.slow  # a process; another: test_server.py
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C can't be sent to one process there")
def test_it_prints_one_address_and_ctrl_c_ends_it(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "lfportrait", "studio", "--folder", str(tmp_path / "new" / "folder"),
         "--no-browser"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/#token=\S{40,} \(Ctrl-C ends\)\n", line)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert (out, err, process.returncode) == ("", "", 0)
    finally:
        process.kill()


@pytest.mark.parametrize("parameters", [
    {}, {"reconstruct.resolutions": [32, 64], "reconstruct.rays": [0.5, 1.0], "encode.size": 0.8,
         "keep_background": True, "encode.compose": False}])
def test_the_command_repeats_what_the_page_did(page, parameters):
    from lfportrait.cli.common import parsed
    from lfportrait.cli.make import Make
    from lfportrait.studio.jobs import Order

    project = page.do("POST", "/api/projects", {"name": "Anna"})["id"]
    path = f"/api/projects/{project}/command"
    assert "--reconstruct" not in page.get(path)["make"], "what is usual is not said"
    options = {"quick": True, "parameters": parameters}
    page.do("PATCH", f"/api/projects/{project}", {"options": options})
    words = shlex.split(page.get(path)["make"])
    assert words[:2] == ["lfportrait", "make"]
    assert parsed(Make, words[2:], "make").config == Order("head", Path(), options=options).chosen()

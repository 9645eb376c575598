"""The explorer's server: it answers the page that knows its token, on this machine, and nobody else."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import re
import signal
import socket
import stat
import struct
import subprocess
import sys
import threading
import urllib.request
import webbrowser
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import browser
import numpy as np
import pytest
from numba.core import event

import phasemap as pm
from phasemap._shared.interrupts import check_stopped
from phasemap.cli import main
from phasemap.explorer.explore import Explorer, serve
from phasemap.explorer.limits import LIMITS
from phasemap.explorer.offered import Opened
from phasemap.explorer.server import HOST, LARGEST, LARGEST_FILE
from phasemap.explorer.setting import values_of
from phasemap.explorer.subject import subject_of
from phasemap.scenes.scene import load_scene

SAMPLES = Path(__file__).parents[2] / "samples"
STEP = str(SAMPLES / "step.toml")
SMALL = "surface.shape=[6, 8]"
SIX = {"changes": {"scan.setpoint": 0.6}}
SMALL_STEP = Opened(subject_of(STEP, overrides=[SMALL]))


@pytest.fixture(scope="module")
def explorer() -> Iterator[Explorer]:
    with serve(SMALL_STEP) as served:
        yield served


def ask(explorer: Explorer, name: str, message: Any = None, **more: Any) -> tuple[int, dict[str, str], bytes]:
    """Ask for an address below the token, by POST if there is a message; `more` replaces token, host, method, body."""
    url = urlsplit(explorer.url)
    connection = http.client.HTTPConnection(HOST, url.port or 0, timeout=120)
    body = more.get("body", None if message is None else json.dumps(message).encode())
    method = more.get("method", "GET" if body is None else "POST")
    with contextlib.closing(connection):
        connection.putrequest(method, more.get("token", url.path.strip("/")).join("//") + name, skip_host=True)
        if (host := more.get("host", url.netloc)) is not None:
            connection.putheader("Host", host)
        if body is not None:
            connection.putheader("Content-Length", str(more.get("length", len(body))))
        connection.endheaders(body)
        answer = connection.getresponse()
        return answer.status, {key.lower(): value for key, value in answer.getheaders()}, answer.read()


def page_file(name: str) -> bytes:
    return files("phasemap.explorer").joinpath("page", name).read_bytes()


def unpacked(content: bytes) -> tuple[dict[str, Any], bytes]:
    (length,) = struct.unpack("<I", content[:4])
    return json.loads(content[4 : 4 + length]), content[4 + length :]


def test_the_page_and_all_its_parts_are_served_and_may_load_nothing_from_elsewhere(explorer: Explorer) -> None:
    code, headers, content = ask(explorer, "")
    assert code == 200 and b"<title>phasemap explorer</title>" in content
    policy = headers["content-security-policy"]
    assert policy.startswith("default-src 'none'") and "http" not in policy and "*" not in policy
    assert headers["referrer-policy"] == "no-referrer" and headers["cache-control"] == "no-store"
    parts = re.findall(r'(?:src|href)="(?!data:)([^"]+)"', content.decode())
    for part in parts:  # which grows by what a script imports
        imported = dict.fromkeys(re.findall(r'from "\./([^"]+)"', page_file(part).decode()))
        parts += [one for one in imported if one not in parts]
    assert [part for part in parts if part.endswith(".js") and b"fetch(route" in page_file(part)] == ["asking.js"]
    assert set(parts) == {"asking.js", "controls.js", "draw.js", "engine.js", "page.css", "page.js", "state.js"}
    for part in {*parts, "knobs.json"}:
        code, headers, content = ask(explorer, part)
        assert code == 200 and headers["content-type"].startswith(("text/css", "text/javascript", "application/json"))
        assert b"http:" not in content and b"https:" not in content


def test_what_the_page_begins_with_names_samples_presets_and_colours(explorer: Explorer) -> None:
    start = json.loads(ask(explorer, "start")[2])
    assert start["first"] == "step" and "blend" in start["samples"]
    assert {len(colours) for colours in start["colours"].values()} == {3 * 256}
    levers = {preset["name"]: preset["values"] for preset in start["presets"]["levers"]}
    assert levers["PPP-NCHR"]["stiffness"] == pm.Cantilever.preset("PPP-NCHR").stiffness
    assert any(preset["name"] == "PDMS" for preset in start["presets"]["materials"])


def test_a_sample_is_described_with_its_values_and_shows_which_material_is_where(explorer: Explorer) -> None:
    about, labels = unpacked(ask(explorer, "sample", {"sample": "step"})[2])
    assert about["materials"] == ["compliant", "stiff"] and about["control"] is None and about["shape"] == [6, 8]
    assert about["values"]["materials.1.modulus"] == 3e9 and about["values"]["cantilever.quality_factor"] == 400.0
    assert np.frombuffer(labels, np.uint8).reshape(6, 8)[0].tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    about, labels = unpacked(ask(explorer, "sample", {"sample": "scan"})[2])
    assert about["control"].startswith("feedback in time") and len(labels) == 192 * 192
    assert ask(explorer, "sample", {"sample": "nothing"})[0] == 422


def test_a_file_that_the_page_sends_is_opened_as_a_sample(explorer: Explorer) -> None:
    code, _, content = ask(explorer, "open/my%20own.toml", body=Path(STEP).read_bytes())
    assert code == 200 and json.loads(content) == {"sample": "my own"}
    about, _ = unpacked(ask(explorer, "picture", {"sample": "my own"})[2])
    assert about["shape"] == [128, 256]
    code, _, content = ask(explorer, "open/bad.toml", body=b"[")
    assert code == 422 and json.loads(content)["error"].startswith(
        "cannot read the scene bad.toml: it is not valid TOML"
    )


def test_a_page_can_ask_whether_the_server_is_there(explorer: Explorer) -> None:
    assert ask(explorer, "alive")[0] == 200


def test_without_anything_to_explore_the_page_begins_with_a_sample() -> None:
    with serve() as explorer:
        assert json.loads(ask(explorer, "start")[2])["first"] == "blend"


def test_behind_a_hub_the_page_has_the_address_of_the_hub_and_still_needs_its_token(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/me/")
    with serve(SMALL_STEP) as explorer:
        url = urlsplit(explorer.url)
        assert f'src="/user/me/proxy/{url.port}{url.path}"' in explorer._repr_html_()
        assert ask(explorer, "start", host="hub.example.org")[0] == 200
        assert ask(explorer, "start", host="hub.example.org", token="wrong")[0] == 403


@pytest.mark.parametrize("name", ["", "start", "page.js"])
@pytest.mark.parametrize("token", ["", "wrong", "wrong" * 99, "%00"])
def test_an_address_without_its_token_gets_nothing(explorer: Explorer, token: str, name: str) -> None:
    code, _, content = ask(explorer, name, token=token)
    assert code == 403 and "token" in json.loads(content)["error"]


@pytest.mark.parametrize("host", [None, "", "example.org", "127.0.0.1", "127.0.0.1:1", "rebound.example:{port}"])
def test_a_request_that_names_another_host_gets_nothing(explorer: Explorer, host: str | None) -> None:
    port = urlsplit(explorer.url).port
    code, _, content = ask(explorer, "", host=host and host.format(port=port))
    assert code == 403 and b"title" not in content
    assert ask(explorer, "", host=f"localhost:{port}")[0] == 200


def test_only_this_machine_can_reach_it(explorer: Explorer) -> None:
    assert explorer._server.socket.getsockname()[0] == "127.0.0.1"


def test_a_picture_is_the_image_that_simulate_gives(explorer: Explorer) -> None:
    code, headers, content = ask(explorer, "picture", SIX)
    about, maps = unpacked(content)
    assert code == 200 and headers["content-type"] == "application/octet-stream" and about["shape"] == [6, 8]
    height, phase = np.frombuffer(maps, "<f4").reshape(2, 6, 8)
    image = load_scene(STEP, [SMALL, "scan.setpoint=0.6"]).simulate()
    np.testing.assert_array_equal(phase, image.phase.values.astype(np.float32))
    assert float(height.min()) == 0.0
    assert [one["name"] for one in about["materials"]] == ["compliant", "stiff"] and about["why"]


def test_curves_the_scan_and_the_map_of_the_contrast_are_answered(explorer: Explorer) -> None:
    curves = json.loads(ask(explorer, "curves", {})[2])
    assert list(curves) == ["compliant", "stiff"] and len(curves["stiff"]["period"]["force"]) == 192
    about, maps = unpacked(ask(explorer, "scan", {})[2])
    assert about["shape"] == [6, 8] and len(maps) == 2 * 4 * 48
    contrast = json.loads(ask(explorer, "contrast", {})[2])
    assert np.shape(contrast["contrast"]) == (len(contrast["amplitudes"]), len(contrast["setpoints"]))


@pytest.mark.parametrize(
    ("what", "name", "begins"),
    [
        ("scene", "step_explored.toml", b"# Saved from phasemap explore."),
        ("image", "step_explored.nc", b"\x89HDF"),
        ("picture", "step_explored.png", b"\x89PNG"),
        ("python", "step_explored.py", b"import phasemap as pm"),
    ],
)
def test_each_button_saves_a_file(explorer: Explorer, what: str, name: str, begins: bytes) -> None:
    code, _, content = ask(explorer, f"save/{what}", SIX)
    about, file = unpacked(content)
    assert code == 200 and about["name"] == name and file.startswith(begins)


@pytest.mark.parametrize("name", ["picture", "curves", "contrast", "scan", "save/scene", "save/image"])
def test_a_bad_value_is_refused_in_the_sentence_that_python_raises(explorer: Explorer, name: str) -> None:
    code, _, content = ask(explorer, name, {"changes": {"scan.setpoint": 1.5}})
    assert code == 422 and json.loads(content)["error"].startswith("setpoint is 1.5; allowed: a number above 0")


@pytest.mark.parametrize(
    ("code", "name", "more"),
    [
        (400, "picture", {"body": b"{"}),
        (400, "picture", {"body": b"[" * 20000}),
        (400, "picture", {"body": b"\xff\xfe"}),
        (404, "nothing", {}),
        (404, "nothing", {"body": b"{}"}),
        (404, "../page.js", {}),
        (404, "page/index.html", {}),
        (413, "picture", {"body": b"", "length": LARGEST + 1}),
        (413, "picture", {"body": b"", "length": "a"}),
        (413, "picture", {"body": b"", "length": "1" * 5000}),
        (413, "open/large.nid", {"body": b"", "length": LARGEST_FILE + 1}),
        (501, "picture", {"body": b"{}", "method": "PUT"}),
    ],
)
def test_what_makes_no_sense_is_refused(explorer: Explorer, code: int, name: str, more: dict[str, Any]) -> None:
    assert ask(explorer, name, **more)[0] == code
    assert ask(explorer, "start")[0] == 200  # and the next one is answered


def test_a_browser_that_goes_away_in_the_middle_is_no_error(
    explorer: Explorer, capfd: pytest.CaptureFixture[str]
) -> None:
    url = urlsplit(explorer.url)
    for _ in range(5):
        with socket.create_connection((HOST, url.port or 0)) as gone:
            gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close is a reset
            gone.sendall(f"GET {url.path}start HTTP/1.1\r\nHost: {url.netloc}\r\n\r\n".encode())
    assert ask(explorer, "start")[0] == 200
    assert capfd.readouterr() == ("", "")


def test_an_error_of_ours_is_an_answer_too(explorer: Explorer, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("phasemap.explorer.answers.picture", broken)
    code, _, content = ask(explorer, "picture", {})
    assert code == 500 and "ZeroDivisionError: by nothing" in json.loads(content)["error"]


def connected(explorer: Explorer, sent: bytes = b"") -> socket.socket:
    """A connection that sends something and then nothing."""
    connection = socket.create_connection((HOST, urlsplit(explorer.url).port or 0), timeout=60)
    connection.sendall(sent)
    return connection


def posted(explorer: Explorer, name: str, body: bytes = b"{}") -> bytes:
    """A request, as it is sent."""
    url = urlsplit(explorer.url)
    return (
        f"POST {url.path}{name} HTTP/1.1\r\nHost: {url.netloc}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body
    )


@pytest.mark.parametrize("name", ["picture", "curves", "contrast", "scan", "save/image"])
def test_work_ends_where_the_page_takes_its_question_back(
    explorer: Explorer, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, ended = threading.Event(), threading.Event()

    def endless(*_: object, **__: object) -> None:
        began.set()
        try:
            while True:
                check_stopped()
        finally:
            ended.set()

    place = "saving" if name == "save/image" else "answers"
    what = {"contrast": "contrast_map", "save/image": "image"}.get(name, name)
    monkeypatch.setattr(f"phasemap.explorer.{place}.{what}", endless)
    with connected(explorer, posted(explorer, name)):
        assert began.wait(60) and not ended.is_set()
    assert ended.wait(60)
    assert explorer.idle.wait(60)


@pytest.mark.parametrize("name", ["picture", "curves", "contrast"])
def test_work_that_takes_too_long_ends_with_a_sentence_that_says_why_and_what_to_do(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, name, LIMITS[name]._replace(seconds=0.0))
    with serve(SMALL_STEP) as explorer:
        code, _, content = ask(explorer, name, {"changes": {"drive.frequency": 60e3}})
        said = json.loads(content)["error"]
    assert code == 503 and said.startswith("This takes longer than the 0 s that the page has for ")
    assert "The drive at 60 kHz is far from the resonance at 300 kHz" in said
    assert "The scene that the page saves runs without a limit" in said


def test_a_drive_far_below_the_resonance_is_refused_at_once(explorer: Explorer) -> None:
    code, _, content = ask(explorer, "picture", {"changes": {"drive.frequency": 1e3}})
    said = json.loads(content)["error"]
    assert code == 422 and said.startswith(
        "drive frequency is 1 kHz; allowed: 3 kHz to 30 MHz in the page, for a resonance at 300 kHz"
    )


def test_what_the_page_says_of_a_long_answer_is_true(explorer: Explorer) -> None:
    def said(**changes: float) -> str:
        return str(json.loads(ask(explorer, "doing", {"changes": changes})[2])["doing"])

    assert said() == "solving …"
    assert said(**{"drive.frequency": 60e3}).startswith("The drive at 60 kHz is far from the resonance")
    with event.trigger_event("numba:compile"):
        assert said().startswith("compiling the solvers, only this once: ")


@pytest.mark.parametrize(
    "body",
    [
        {"changes": {"scan.setpoint": 10**400}}, {"changes": {"tip.radius": -(10**400)}},
        {"changes": {"drive.frequency": 10**400}}, {"pair": [10**400, 0]},
        {"changes": {"materials.0.modulus": 10**400}}, {"changes": 10**400}, {"exact": 10**400}, 10**400,
    ],
)  # fmt: skip
def test_a_number_of_many_digits_is_refused_in_one_sentence(
    explorer: Explorer, body: object, caplog: pytest.LogCaptureFixture
) -> None:
    code, _, content = ask(explorer, "picture", body)
    assert code == 422 and "; allowed: " in json.loads(content)["error"]
    assert len(content) < 500  # of which 300 are of the number
    code, _, content = ask(explorer, "picture", body=json.dumps(body).replace("0" * 400, "0" * 5000).encode())
    assert code == 400 and json.loads(content)["error"] == "The message is not JSON." and not caplog.records


def test_explore_gives_an_address_shows_itself_in_a_notebook_and_closes() -> None:
    explorer = pm.explore(STEP, browser=False)
    port = urlsplit(explorer.url).port
    assert explorer.url in repr(explorer)
    assert f'<iframe src="{explorer.url}"' in explorer._repr_html_()
    assert ask(explorer, "")[0] == 200
    explorer.close()
    explorer.close()
    assert repr(explorer) == "Explorer(closed)" and "iframe" not in explorer._repr_html_()
    with pytest.raises(ConnectionRefusedError), socket.create_connection((HOST, port or 0)):
        pass


def test_every_explorer_has_a_token_of_its_own() -> None:
    with serve(SMALL_STEP) as one, serve(SMALL_STEP) as other:
        tokens = [urlsplit(explorer.url).path.strip("/") for explorer in (one, other)]
        assert tokens[0] != tokens[1] and min(map(len, tokens)) >= 24
        assert ask(other, "", token=tokens[0])[0] == 403


@pytest.mark.parametrize(("browser", "opened"), [(None, 1), (True, 1), (False, 0)])
def test_the_browser_opens_by_itself_and_nobody_else_sees_the_token(
    browser: bool | None, opened: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    with pm.explore(STEP, browser=browser) as explorer:
        assert len(addresses) == opened
        for address in addresses:
            assert urlsplit(explorer.url).path.strip("/") not in address
            file = Path(urllib.request.url2pathname(urlsplit(address).path))
            assert f'content="0;url={explorer.url}"' in file.read_text()
            if os.name == "posix":
                assert stat.S_IMODE(file.stat().st_mode) == 0o600 and stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert not any(Path(urllib.request.url2pathname(urlsplit(address).path)).parent.exists() for address in addresses)


def test_where_the_file_for_the_browser_cannot_be_written_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: "/nowhere/at/all")
    with pytest.raises(pm.FileError, match=r"cannot write a file for the browser: No such file.*--no-browser"):
        pm.explore(STEP, browser=True)


def test_a_port_that_is_taken_is_said(capsys: pytest.CaptureFixture[str], explorer: Explorer) -> None:
    port = urlsplit(explorer.url).port
    assert main(["explore", STEP, SMALL, "--no-browser", "--port", str(port)]) == 2
    assert f"cannot serve on 127.0.0.1 port {port}" in capsys.readouterr().err


def test_the_command_serves_until_ctrl_c_and_ends_cleanly() -> None:
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # as in a terminal
    code += f"from phasemap.cli import main; raise SystemExit(main(['explore', {STEP!r}, {SMALL!r}, '--no-browser']))"
    command = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert command.stdout is not None
    line = command.stdout.readline()
    url = urlsplit(line.removeprefix("the explorer is at ").strip())
    connection = http.client.HTTPConnection(HOST, url.port or 0, timeout=60)
    with contextlib.closing(connection):
        connection.request("GET", url.path + "start")
        assert connection.getresponse().status == 200
    os.kill(command.pid, signal.SIGINT)
    out, err = command.communicate(timeout=60)
    assert command.returncode == 0 and err == "" and "the explorer is closed" in out


@browser.needed
def test_a_real_browser_draws_the_page(explorer: Explorer, tmp_path: Path) -> None:
    page = browser.seen(explorer.url, tmp_path)
    assert re.search(r'id="state"[^>]*>image in \d+ ms, curves in \d+ ms<', page)
    assert re.search(r'id="problem"[^>]* hidden=""[^>]*></p>', page)
    assert "stiff is " in page and page.count("<tr><td>") == 2 and "selected" not in page
    for key in values_of(SMALL_STEP.subject):
        assert f'id="{key}"' in page, key


@pytest.mark.slow
@browser.needed
def test_a_link_holds_everything_that_was_set(explorer: Explorer, tmp_path: Path) -> None:
    link = "#sample=step&interaction.contact=hertz&drive.free_amplitude=3e-6&materials.0.damping=0&names=PDMS,glass"
    page = browser.seen(explorer.url + link, tmp_path)
    assert "glass and PDMS look alike" in page and re.search("<td><span[^>]*></span>PDMS</td>", page)
    assert "free_amplitude = 3e-06 m; usual 50 pm … 1 µm." in page  # which is one of the warnings


@pytest.mark.slow
@browser.needed
def test_a_link_to_a_sample_that_is_not_here_says_so(explorer: Explorer, tmp_path: Path) -> None:
    page = browser.seen(f"{explorer.url}#sample=mine&tip.radius=2e-8", tmp_path)
    assert "sample is 'mine'; allowed: " in page and "Open its file in the page" in page

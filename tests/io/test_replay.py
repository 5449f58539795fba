# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim replay` and `recover`: from a bag to a recording and a picture, or one clear line."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.cli.verbs import replay as verb
from rb_sim.cli.verbs.replay import recover, replay
from rb_sim.io.rerun import viewer
from rb_sim.io.rerun import viewer as rerun_screenshot
from tests.bags.scenes import PUSHED, record_run

RERUN = Path(sys.executable).with_name("rerun")
needs_rerun = pytest.mark.skipif(not RERUN.exists(), reason="rerun-sdk is not installed")
DATA = ("/world", "/plots", "/about")
NO_VULKAN = {"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}


def stats(path: Path) -> list[str]:
    """Chunks per entity of the data (the blueprint's have random names), as rerun counts them."""
    command = [str(RERUN), "rrd", "stats", str(path)]
    text = subprocess.run(command, check=True, capture_output=True, text=True, timeout=240).stdout
    return sorted(line for line in text.splitlines() if line.startswith(DATA))


@needs_rerun
def test_replay_saves_what_the_run_would_have_recorded(
    record, tmp_path, scene, layout, samples, capsys
):
    from rb_sim.io.rerun.rerun_sink import RerunSink

    live = RerunSink(tmp_path / "live.rrd")
    live.open(scene, layout)
    live.write(samples(200))
    live.close({"steps": 7})
    saved = tmp_path / "replayed.rrd"
    replay(record(summary={"steps": 7}), save=saved)
    assert capsys.readouterr().out == f"wrote {saved}\n"
    subprocess.run([RERUN, "rrd", "verify", saved], check=True, capture_output=True, timeout=240)
    assert stats(saved) == stats(live.path)


def test_half_a_recording_is_not_left(record, tmp_path, monkeypatch):
    """Broken off by Ctrl-C: it would open, and pass for the whole run."""

    def half(reader, recording):
        recording.write_bytes(b"RRF2")
        raise KeyboardInterrupt

    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    monkeypatch.setattr(verb, "convert", half)
    with pytest.raises(KeyboardInterrupt):
        replay(record(), save=tmp_path / "half.rrd")
    assert not (tmp_path / "half.rrd").exists()


def test_an_older_recording_stays_where_nothing_was_written(record, tmp_path, monkeypatch):
    def refuse(reader, recording):
        raise SinkError("no")

    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    monkeypatch.setattr(verb, "convert", refuse)
    (tmp_path / "old.rrd").write_bytes(b"RRF2")
    with pytest.raises(SinkError, match="^no$"):
        replay(record(), save=tmp_path / "old.rrd")
    assert (tmp_path / "old.rrd").exists()


@needs_rerun
def test_without_a_screen_it_says_what_to_do(record, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SinkError, match="^no screen for the Rerun viewer: use --save or"):
        replay(record())


def test_endings_are_checked_before_anything_is_read(tmp_path):
    with pytest.raises(SinkError, match=r"a.mp4: the name must end in \.rrd$"):
        replay(tmp_path / "none", save=Path("a.mp4"))
    with pytest.raises(SinkError, match=r"a.jpg: the name must end in \.png$"):
        replay(tmp_path / "none", screenshot=Path("a.jpg"))
    with pytest.raises(SinkError, match="does not exist; must be a bag"):
        replay(tmp_path / "none", save=Path("a.rrd"))


def test_recover_says_what_it_did(record, tmp_path, capsys):
    bag = record()
    data = (bag / "bag_0.mcap").read_bytes()
    recover(bag, tmp_path / "whole")
    assert capsys.readouterr().out == (
        f"wrote {tmp_path / 'whole'}: {200 * 17 + 3} messages, the bag was complete\n"
    )
    (bag / "bag_0.mcap").write_bytes(data[:-20])
    recover(bag)
    assert "all readable messages" in capsys.readouterr().out
    (bag / "bag_0.mcap").write_bytes(data[: len(data) // 2])
    recover(bag, tmp_path / "half")
    assert "is cut off; messages missing after t = " in capsys.readouterr().err


@needs_rerun
@pytest.mark.slow
def test_screenshot_without_vulkan_is_one_clear_line(record, tmp_path, monkeypatch):
    for name, value in NO_VULKAN.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SinkError) as caught:
        replay(record(), screenshot=tmp_path / "picture.png")
    assert str(caught.value) == (
        "the Rerun viewer cannot draw here: "
        "no Vulkan driver (on Debian and Ubuntu: apt install mesa-vulkan-drivers)"
    )


def test_viewer_that_dies_gives_its_last_words(tmp_path, monkeypatch):
    viewer = tmp_path / "rerun"
    viewer.write_text("#!/bin/sh\necho Error: out of paint >&2\nexit 3\n")
    viewer.chmod(0o755)
    monkeypatch.setattr(rerun_screenshot, "rerun_executable", lambda: str(viewer))
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    with pytest.raises(SinkError, match="cannot draw here: Error: out of paint$"):
        rerun_screenshot.save_screenshot(tmp_path / "r.rrd", tmp_path / "p.png")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc: not Linux")
def test_the_viewer_is_gone_afterwards(tmp_path, monkeypatch):
    """The command is a wrapper: its child must not outlive it, nor what it keeps in TMPDIR."""
    viewer, child = tmp_path / "rerun", tmp_path / "child"
    kept = tmp_path / "kept"
    kept.mkdir()
    monkeypatch.setenv("TMPDIR", str(kept))
    monkeypatch.setattr(tempfile, "tempdir", str(kept))
    lines = [
        "#!/bin/sh",
        'mkdir "$TMPDIR/rerun-data"',
        "sleep 600 &",
        f"echo $! > {child}.new",
        f"mv {child}.new {child}",
        "wait",
    ]
    viewer.write_text("\n".join(lines))
    viewer.chmod(0o755)
    monkeypatch.setattr(rerun_screenshot, "rerun_executable", lambda: str(viewer))
    with rerun_screenshot._viewer(tmp_path / "r.rrd", (100, 100)):
        wait_until(child.exists)
        number = int(child.read_text())
        os.kill(number, 0)
    wait_until(lambda: not alive(number))
    assert list(kept.iterdir()) == []


def alive(number: int) -> bool:
    """True if the process runs; one that is dead but not yet reaped does not."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until(condition) -> None:
    deadline = time.monotonic() + 240
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_no_viewer_at_all(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(Exception, match=r"pip install 'rb_sim\[rerun\]'"):
        rerun_screenshot.rerun_executable()


# A film of a bag: made by the Rerun viewer and ffmpeg, or one line that says why not.


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return record_run(PUSHED, tmp_path_factory.mktemp("film") / "bag")


def test_without_ffmpeg_it_says_so_at_once(bag, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SinkError, match="needs the program ffmpeg .* apt install ffmpeg") as caught:
        replay(bag, video=tmp_path / "film.mp4")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg")
def test_another_ending_is_refused(bag, tmp_path):
    with pytest.raises(SinkError, match=r"film.gif: the name must end in .mp4"):
        replay(bag, video=tmp_path / "film.gif")


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="no ffmpeg")
def test_a_film_has_its_pictures_and_moves(bag, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(viewer, "SHORTEST", 0.2)
    monkeypatch.setattr(viewer, "LONGEST", 0.2)
    path = tmp_path / "film.mp4"
    try:
        replay(bag, video=path)
    except MissingExtraError as error:
        pytest.skip(str(error))
    except SinkError as error:
        if "no Vulkan driver" in str(error):
            pytest.skip(str(error))
        raise
    assert "6 pictures, 0.2 s of film at 5 times real time" in capsys.readouterr().out
    shown = "stream=codec_name,nb_read_frames,r_frame_rate"
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", shown, "-of", "csv=p=0"]
    probe.append(str(path))
    reported = subprocess.run(probe, capture_output=True, text=True, check=True).stdout.strip()
    assert reported == "h264,25/1,6"
    command = ["ffmpeg", "-loglevel", "error", "-i", str(path), "-f", "framemd5", "-"]
    rows = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    pictures = {row.rpartition(",")[2] for row in rows if not row.startswith("#")}
    assert len(pictures) == 6  # the box falls from one to the next


# The viewer's process ends with ours, whatever ends ours.


HOST = """
import subprocess, sys
from rb_sim.io.rerun.viewer import viewer_process
child = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
grandchild = "import os, time; print(os.getpid(), flush=True); time.sleep(600)"
with viewer_process([sys.executable, "-c", child, grandchild]) as process:
    process.wait()
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_the_viewer_and_its_child_too(number: signal.Signals):
    signals = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL);"
    signals += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    command = [sys.executable, "-c", signals + HOST]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as host:
        assert host.stdout is not None
        grandchild = int(host.stdout.readline())
        assert alive(grandchild)
        host.send_signal(number)
        status = host.wait(timeout=240)
    assert status in (128 + number, -number)
    wait_until(lambda: not alive(grandchild))

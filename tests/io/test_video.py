# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A film of a bag: made by the Rerun viewer and ffmpeg, or one line that says why not."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.cli.verbs.replay import replay
from rb_sim.io.rerun import viewer
from tests.bags.scenes import PUSHED, record_run
from tests.interpreted import interpreted


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return interpreted(record_run, PUSHED, tmp_path_factory.mktemp("film") / "bag")


def test_without_ffmpeg_it_says_so_at_once(bag, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SinkError, match="needs the program ffmpeg .* apt install ffmpeg") as caught:
        replay(bag, video=tmp_path / "film.mp4")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg")
def test_another_ending_is_refused(bag, tmp_path):
    with pytest.raises(SinkError, match=r"film.gif: the name must end in .mp4"):
        replay(bag, video=tmp_path / "film.gif")


def test_length_of_a_film():
    assert [viewer.length_of(t) for t in (0.5, 7.0, 100.0)] == [4.0, 7.0, 20.0]


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
    told = subprocess.run(probe, capture_output=True, text=True, check=True).stdout.strip()
    assert told == "h264,25/1,6"
    command = ["ffmpeg", "-loglevel", "error", "-i", str(path), "-f", "framemd5", "-"]
    rows = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    pictures = {row.rpartition(",")[2] for row in rows if not row.startswith("#")}
    assert len(pictures) == 6  # the box falls from one to the next

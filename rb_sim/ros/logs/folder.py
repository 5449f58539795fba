# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The folder that a node logs into: nothing in it is replaced unasked, and one node has it."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

from rb_sim.base.errors import SinkError
from rb_sim.simulation.outputs import refuse_logs

TIME_FIELD = "{time}"
INSIST = f"put {TIME_FIELD} in its name, or use overwrite:=true"


def out_folder(out: str, *, overwrite: bool) -> Path:
    """The folder for the logs. RbSimError: there are some in it, and they are not to be replaced.

    {time} in its name becomes the date and time; see `own_folder` for where that exists, too.
    """
    if TIME_FIELD in out:
        return Path(out.replace(TIME_FIELD, time.strftime("%Y_%m_%d-%H_%M_%S")))
    folder = Path(out)
    if not overwrite:
        refuse_logs(folder, "parameter out", INSIST)
    return folder


def own_folder(named: Path) -> Path:
    """Make the folder; where it exists, one with a number behind its name. Two nodes that were
    started in the same second each get one: making a folder succeeds for one of them only.
    """
    for k in range(1000):
        folder = named.with_name(f"{named.name}-{k + 1}") if k else named
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError:
            pass  # reported by the log that cannot be begun there
        return folder
    return named


def claim(folder: Path, *, overwrite: bool) -> None:
    """Have the folder until this process ends. RbSimError: another process logs there, or has since
    it was chosen; with `overwrite` that does not matter.

    A folder that cannot be made, or locked, is reported by the log that cannot be begun there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if not overwrite:
            raise SinkError(f"{folder}: another process is logging there") from None
    except OSError:
        pass
    if not overwrite:
        refuse_logs(folder, "parameter out", INSIST)

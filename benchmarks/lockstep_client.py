# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A client of ~/advance in C, over rcl: compiled against the headers of the ROS wheels."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from rb_sim.ros import build_interfaces

SOURCE = Path(__file__).with_suffix(".c")
PACKAGE = "rb_sim_interfaces"


def compiled(folder: Path) -> Path:
    """The program, in this folder. CalledProcessError: it does not compile."""
    built, prefix = build_interfaces.build(PACKAGE), Path(sys.prefix)
    own, wheels = built / PACKAGE, prefix / "lib"
    includes = [built / build_interfaces.HEADERS, *sorted((prefix / "include").iterdir())]
    program = folder / SOURCE.stem
    command = ["gcc", "-O2", "-Wall", "-Werror", str(SOURCE), "-o", str(program)]
    command += [word for path in includes for word in ("-I", str(path))]
    for path in (own, wheels):
        command += ["-L", str(path), f"-Wl,-rpath,{path}"]
    command += [f"-l{PACKAGE}__rosidl_{kind}" for kind in ("typesupport_c", "generator_c")]
    command += ["-lrcl", "-lrmw", "-lrcutils", "-lrosidl_runtime_c"]
    # what these need in turn is found when it runs, where rclpy finds it
    command += [
        "-Wl,--allow-shlib-undefined",
        "-Wl,--unresolved-symbols=ignore-in-shared-libs",
        "-rdynamic",
    ]
    subprocess.run(command, check=True)
    return program


def possible() -> bool:
    """Whether there is a compiler."""
    return shutil.which("gcc") is not None and shutil.which("g++") is not None


def requests(program: Path, service: str, count: int, warm: int = 20) -> float:
    """Requests per second. SystemExit: the node refused one, or is not there."""
    command = [str(program), service, str(count), str(warm)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment())
    if done.returncode:
        raise SystemExit(f"{program.name}: {done.stderr.strip()}")
    # before it the middleware may have had something to tell, as of a port that a killed node left
    return float(done.stdout.splitlines()[-1])


def environment() -> dict[str, str]:
    """Where the libraries of the wheels are, and those that they bring."""
    brought = sorted(Path(sysconfig.get_paths()["platlib"]).glob("*.libs"))
    folders = [build_interfaces.build(PACKAGE) / PACKAGE, Path(sys.prefix, "lib"), *brought]
    return os.environ | {"LD_LIBRARY_PATH": ":".join(map(str, folders))}

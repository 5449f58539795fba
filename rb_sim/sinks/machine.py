"""What a run depends on beside its scene: versions of programs, and the processor."""

from __future__ import annotations

import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("rb_sim", "numpy", "scipy", "llvmlite", "mcap")


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Version of each program that a result depends on; of ROS, its distribution if it is there."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    ros = os.environ.get("ROS_DISTRO") or _ros_of_wheels()
    return found | ({"ros": ros} if ros else {})


def _ros_of_wheels() -> str:
    """The distribution of a rclpy that was installed from wheels, with its version."""
    for name in ("ros-jazzy-rclpy", "ros-rclpy", "rclpy"):
        try:
            return f"rclpy {version(name)}"
        except PackageNotFoundError:
            continue
    return ""


@lru_cache(maxsize=1)
def host() -> dict[str, str]:
    """The processor and the system; nothing that names the machine or its user."""
    return {"cpu": _cpu(), "machine": platform.machine(), "system": platform.system()}


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    return names[0] if names else platform.processor() or "unknown"

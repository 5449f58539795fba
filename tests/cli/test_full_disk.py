# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Verbs whose results do not fit: one line, and no half copy of a bag."""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.cli.verbs.analyze import AnalyzeOptions, analyze
from rb_sim.cli.verbs.compare import CompareOptions, compare
from rb_sim.io.bag.recover import recover_bag
from rb_sim.simulation.outputs import writing
from tests.bags.analysis import foreign


@contextmanager
def small_files(size: int) -> Iterator[None]:
    """No file may have more bytes: RLIMIT_FSIZE stands for a full disk. Python would keep what it
    compiles meanwhile cut off, too."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = kept


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    return foreign.write(tmp_path_factory.mktemp("full") / "bag")


@pytest.mark.parametrize("verb", ["analyze", "compare"])
def test_results_that_do_not_fit_are_told_in_one_line(verb, bag, tmp_path):
    out = tmp_path / "out"
    with small_files(200), pytest.raises(RbSimError) as caught:
        if verb == "analyze":
            analyze(AnalyzeOptions(bag, out))
        else:
            compare(CompareOptions(bag, str(bag), out=out))
    assert str(caught.value) == f"--out {out}: cannot write there: File too large"


def test_what_is_said_of_a_folder(tmp_path):
    with pytest.raises(RbSimError, match="^--out .*out: cannot write there: No space left$"):
        with writing(tmp_path / "out"):
            raise OSError(28, "No space left")


@pytest.mark.parametrize("size", [0, 200, 20_000])
def test_a_copy_that_does_not_fit_is_removed(size, bag, tmp_path):
    """At its first byte, in its first chunk, and when it is finished."""
    with small_files(size), pytest.raises(SinkError, match="cannot recover: File too large$"):
        recover_bag(bag, tmp_path / "copy")
    assert list(tmp_path.iterdir()) == []

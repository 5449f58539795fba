# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Samples by hand: of their columns only those that a watch reads."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np


class Block(SimpleNamespace):
    """Samples at some times, with columns of numbers."""

    def __init__(self, t: Any, **columns: Any) -> None:
        arrays = {k: v if k == "events" else np.array(v, dtype=float) for k, v in columns.items()}
        super().__init__(t=np.array(t, dtype=float), **arrays)

    def __len__(self) -> int:
        return len(self.t)

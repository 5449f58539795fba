# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pictures with few colours, so that they are small files."""

from __future__ import annotations

from PIL import Image

COLORS = 256


def few_colors(image: Image.Image) -> Image.Image:
    """The picture in its COLORS most telling colours, without dither.

    They are put right by one round of k-means: those of the median cut alone are means of boxes,
    among which the colour of a thin line is lost.
    """
    return image.quantize(COLORS, kmeans=1, dither=Image.Dither.NONE)

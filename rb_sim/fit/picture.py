"""What a fit leaves: residuals over time, for each body."""

from __future__ import annotations

from pathlib import Path

from rb_sim.fit.fit import Fitted

ROUND_OFF = 1e-12
"""[m, rad] residuals below are drawn as zero."""


def picture(found: Fitted, path: Path) -> None:
    """Write residuals of position and attitude, with the noise that was found as a band."""
    from matplotlib.figure import Figure

    n = len(found.residuals)
    figure = Figure(figsize=(9, 1 + 4.2 * n), layout="constrained")
    axes = figure.subplots(2 * n, 1, sharex=True)
    start = min(float(t[0]) for t, _, _ in found.residuals.values())
    for k, (body, (t, position, turn)) in enumerate(found.residuals.items()):
        rows = (("position", position, "m"), ("angle", turn, "rad"))
        for axis, (name, values, unit) in zip(axes[2 * k : 2 * k + 2], rows, strict=True):
            for column, label in zip(values.T, "xyz", strict=True):
                axis.plot(t - start, column, ".", markersize=2, label=label)
            band = found.noise[name]
            axis.axhspan(-band, band, color="0.9", zorder=0)
            if max(band, float(abs(values).max(initial=0.0))) < ROUND_OFF:
                axis.set_ylim(-ROUND_OFF, ROUND_OFF)
            axis.set_ylabel(f"{body}: {name} left [{unit}]")
            axis.legend(fontsize=7, loc="upper right")
    axes[-1].set_xlabel("t [s] from the first pose")
    figure.savefig(path, dpi=120)

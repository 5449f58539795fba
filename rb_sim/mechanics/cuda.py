"""Several runs at once on a GPU: the laws and loops of lanes, a thread a run, through CuPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from rb_sim.graph.c_source import c_function
from rb_sim.integrate import lane_loops
from rb_sim.integrate.layout import FINE, LEFT_DOMAIN, NOT_FINITE, STEP_UNDERFLOW, ULPS
from rb_sim.mechanics.lane_motions import Lanes, Runs
from rb_sim.mechanics.samples import Array

# CUDA's text of a sweep's kernels: one thread a run, the loops of rb_sim.integrate.lane_loops for
# one lane.
#
# `step` and `sample` are printed from the graphs (rb_sim.graph.c_source); what stands here is how
# steps follow each other. It is C++ that any compiler takes which is told what __global__ is.


NAMES = {
    "FINE": FINE,
    "NOT_FINITE": NOT_FINITE,
    "STEP_UNDERFLOW": STEP_UNDERFLOW,
    "LEFT_DOMAIN": LEFT_DOMAIN,
    "OPEN": lane_loops.OPEN,
    "ULPS": ULPS,
    "MOST_FIRST": lane_loops.MOST_FIRST,
    "ADVANCE": lane_loops.ADVANCE,
    "FIRST": lane_loops.FIRST,
    "EXTRA_INPUTS": lane_loops.EXTRA_INPUTS,
    "STEP": "M + " + str(lane_loops.STEP),
    "SAMPLING": "M + " + str(lane_loops.SAMPLING),
    "FORCED": "M + " + str(lane_loops.FORCED),
    "TOLERANCE": "M + " + str(lane_loops.TOLERANCE),
    "LARGEST": "M + " + str(lane_loops.LARGEST),
    "TOTAL": "2 * N + " + str(lane_loops.TOTAL),
    "INSIDE": "2 * N + " + str(lane_loops.INSIDE),
    "FIXED_ROW": "2 * N + " + str(lane_loops.FIXED_EXTRA),
    "ERROR": "6 * N + " + str(lane_loops.ERROR),
    "ACCEPTED": "6 * N + " + str(lane_loops.ACCEPTED),
    "FOLLOWING": "6 * N + " + str(lane_loops.FOLLOWING),
    "WITHIN": "6 * N + " + str(lane_loops.WITHIN),
    "ALL": "6 * N + " + str(lane_loops.ALL),
    "ADAPTIVE_ROW": "6 * N + " + str(lane_loops.ADAPTIVE_EXTRA),
}


def program(step: str, sample: str, sizes: dict[str, int], adaptive: bool) -> str:
    """The text of the module. sizes: N coordinates, M inputs of the laws, WIDTH columns kept."""
    names = {**sizes, **NAMES}
    head = [f"#define {name} ({value})" for name, value in names.items()]
    carry = [ADAPTIVE, CARRY, ADAPTIVE_RUN] if adaptive else [CARRY, FIXED_RUN]
    return "\n".join([*head, step, sample, COMMON, *carry, SAMPLES])


COMMON = """
__device__ static bool ended_well(double total, double within, int *status)
{
    *status = !isfinite(total) ? NOT_FINITE : within == 0.0 ? LEFT_DOMAIN : OPEN;
    return *status == OPEN;
}

__device__ static void keep(double *path, const double *y)
{
    for (int i = 0; i < N; i++) path[i] = y[i];
}
"""

CARRY = """
extern "C" __global__ void carry(
    long long runs, long long times, long long most, double h, double tolerance, double largest,
    const double *starts, const double *given, const double *instants, double *paths,
    long long *results)
{
    const long long run = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (run >= runs) return;
"""
"""How the kernel begins that carries a run to its last sample, in fixed steps or adaptive ones."""

FIXED_RUN = """
    double p[M + EXTRA_INPUTS], rows[3][FIXED_ROW];
    for (int i = 0; i < M; i++) p[i] = given[run * M + i];
    for (int i = 0; i < N; i++) rows[0][i] = starts[run * N + i];
    for (int i = N; i < FIXED_ROW; i++) rows[0][i] = 0.0;
    double before = 0.0, now = 0.0;
    long long steps = 0;
    int at = 0, status = OPEN;
    for (long long k = 0; k < times; k++) {
        const double t = instants[k], slack = ULPS * fabs(t);
        while (now < t - slack && status == OPEN && steps < most) {
            p[STEP] = h;
            step(now, rows[at], p, rows[1 - at]);
            at = 1 - at;
            steps++;
            before = now;
            now = steps * h;
            ended_well(rows[at][TOTAL], rows[at][INSIDE], &status);
        }
        if (status != OPEN || now < t - slack) break;
        int from = at;
        if (t < now - slack) {
            from = 1 - at;
            if (t > before + slack) {
                p[STEP] = t - before;
                step(before, rows[1 - at], p, rows[2]);
                from = 2;
            }
        }
        keep(paths + (run * times + k) * N, rows[from]);
        if (k == times - 1) status = FINE;
    }
    results[2 * run] = status;
    results[2 * run + 1] = steps;
}
"""

ADAPTIVE = """
/* What a run is at; its rows: old, new and tried coordinates with their carries, then ERROR ... */
struct Run {
    double rows[2][ADAPTIVE_ROW], p[M + EXTRA_INPUTS];
    double t0, t1, next, tried, until, start;
    long long steps, tries;
    int mode, at;
};

__device__ static void ask(Run *r, double start, double h, double sampling)
{
    r->p[STEP] = h;
    r->p[SAMPLING] = sampling;
    r->start = start;
}

__device__ static void go_on(Run *r)
{
    if (r->next == 0.0) {
        r->mode = FIRST;
        r->next = r->p[LARGEST];
    }
    r->until = r->t1 + r->next;
    r->tried = r->until - r->t1;
    const double size = fabs(r->t1) > 1e-3 ? fabs(r->t1) : 1e-3;
    const bool small = !(r->tried > 4.0 * ULPS * size);
    ask(r, r->t1, r->tried, 0.0);
    r->p[FORCED] = small && r->mode == ADVANCE ? 1.0 : 0.0;
}

__device__ static int judge(Run *r)
{
    const double *row = r->rows[r->at];
    const double error = row[ERROR];
    if (row[ACCEPTED] != 0.0) {
        double following = row[FOLLOWING];
        if (r->mode == ADVANCE && r->tries > 0 && r->tried < following) following = r->tried;
        r->next = following;
        r->t0 = r->t1;
        r->t1 = r->until;
        r->steps++;
        r->tries = 0;
        r->mode = ADVANCE;
        int status;
        if (!ended_well(row[ALL], row[WITHIN], &status)) return status;
        return error <= 1.0 ? OPEN : STEP_UNDERFLOW;
    }
    r->tries++;
    if (r->mode != FIRST) {
        r->next = row[FOLLOWING];
        return OPEN;
    }
    double factor = 0.01;
    if (isfinite(error)) {
        factor = 0.9 / sqrt(sqrt(sqrt(error)));
        factor = factor < 0.01 ? 0.01 : factor > 0.5 ? 0.5 : factor;
    }
    r->next *= factor;
    if (r->tries == MOST_FIRST) {
        r->mode = ADVANCE;
        r->tries = 0;
    }
    return OPEN;
}
"""

ADAPTIVE_RUN = """
    Run r;
    for (int i = 0; i < M; i++) r.p[i] = given[run * M + i];
    r.p[TOLERANCE] = tolerance;
    r.p[LARGEST] = largest;
    r.p[FORCED] = 0.0;
    for (int i = 0; i < ADAPTIVE_ROW; i++) r.rows[0][i] = 0.0;
    for (int i = 0; i < N; i++) r.rows[0][i] = r.rows[0][2 * N + i] = starts[run * N + i];
    r.t0 = r.t1 = r.next = r.tried = r.until = r.start = 0.0;
    r.steps = r.tries = 0;
    r.mode = FIRST;
    r.at = 0;
    int status = OPEN;
    long long k = 0, attempts = 0;
    while (k < times && attempts < most) {
        const double t = instants[k], slack = ULPS * fabs(t);
        double *path = paths + (run * times + k) * N;
        const double *row = r.rows[r.at];
        const bool sampling = r.t1 >= t - slack;
        if (sampling && (t >= r.t1 - slack || t <= r.t0 + slack)) {
            keep(path, t >= r.t1 - slack ? row + 2 * N : row);
            k++;
            continue;
        }
        if (sampling) ask(&r, r.t0, t - r.t0, 1.0);
        else go_on(&r);
        step(r.start, row, r.p, r.rows[1 - r.at]);
        r.at = 1 - r.at;
        attempts++;
        if (sampling) {
            keep(path, r.rows[r.at] + 4 * N);
            k++;
            continue;
        }
        status = judge(&r);
        if (status != OPEN) break;
    }
    results[2 * run] = k == times ? FINE : status;
    results[2 * run + 1] = r.steps;
}
"""

SAMPLES = """
extern "C" __global__ void samples(
    long long runs, long long times, const double *paths, const double *given,
    const double *instants, double *out)
{
    const long long i = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= runs * times) return;
    double p[M + EXTRA_INPUTS];
    for (int j = 0; j < M; j++) p[j] = given[(i / times) * M + j];
    sample(instants[i % times], paths + i * N, p, out + i * WIDTH);
}
"""


THREADS = 64
"""Of a block: a run keeps many numbers in registers, so that few fit."""

MOST_ATTEMPTS = 1 << 28
"""Steps tried of one run, after which it stays OPEN: a kernel cannot be asked to end."""

OPTIONS = ("--std=c++17", "--fmad=false")
"""No fused multiply-add: what the processor computes, up to the sines of CUDA's library."""


def why_not() -> str | None:
    """Why no GPU can be used here; None where one can."""
    try:
        cupy = import_module("cupy")
    except ImportError:
        return "CuPy is not installed; pip install 'rb_sim[cuda]'"
    try:
        count = cupy.cuda.runtime.getDeviceCount()
    except Exception as error:  # CuPy's own class, which needs CuPy to be named
        return f"CUDA finds no GPU ({error})".splitlines()[0]
    return None if count else "CUDA finds no GPU"


class CudaLanes(Lanes):
    """As Lanes, on the GPU that CuPy takes."""

    @cached_property
    def source(self) -> str | None:
        """The kernels in CUDA; None where runs cannot go together."""
        outputs = self.step_outputs()
        if outputs is None:
            return None
        step = c_function("step", outputs)
        sample = c_function("sample", self.sample_outputs())
        sizes = {"N": self.n, "M": self._given, "WIDTH": len(self.columns)}
        if step is None or sample is None:
            return None
        return program(step, sample, sizes, self.adaptive)

    @property
    def possible(self) -> bool:
        return self.source is not None

    @cached_property
    def _module(self) -> Any:
        return import_module("cupy").RawModule(code=self.source, options=OPTIONS)

    def run(
        self,
        starts: Array,
        given: Array,
        times: Array,
        goes_on: Callable[[], bool] = lambda: True,
    ) -> Runs:
        """As Lanes.run; `goes_on` is not asked: a run ends after MOST_ATTEMPTS."""
        cupy, runs, count = import_module("cupy"), len(starts), len(times)
        starts, given, times = (
            cupy.asarray(np.ascontiguousarray(x, dtype=float)) for x in (starts, given, times)
        )
        paths = cupy.zeros((runs, count, self.n))
        results = cupy.zeros((runs, 2), dtype=np.int64)
        setting = [float(getattr(self.method, name, 0.0)) for name in SETTINGS]
        arguments = (*setting, starts, given, times, paths, results)
        self._launch("carry", runs, (runs, count, MOST_ATTEMPTS, *arguments))
        out = cupy.zeros((runs, count, len(self.columns)))
        self._launch("samples", runs * count, (runs, count, paths, given, times, out))
        statuses, steps = cupy.asnumpy(results).T
        return Runs(cupy.asnumpy(out), statuses, steps)

    def _launch(self, name: str, threads: int, arguments: tuple[Any, ...]) -> None:
        numbers = tuple(np.int64(x) if isinstance(x, int) else x for x in arguments)
        blocks = -(-threads // THREADS)
        self._module.get_function(name)((blocks,), (THREADS,), numbers)


SETTINGS = ("step", "tolerance", "largest_step")
"""Of a method, in the order of the kernel's arguments; 0 where it has none."""

"""LLVM IR that sums a series and its derivative."""

from __future__ import annotations

from rb_sim.graph.emit import constant
from rb_sim.graph.series_factors import LANES
from rb_sim.graph.series_writer import GROUP, Writer


class Sum(Writer):
    """Writes the law that sums."""

    def sum(self) -> str:
        """`add`: Horner's rule for the series and its derivative."""
        n, p, width = self.series.n, self.p, self.series.width
        head = f"define void @law(double %h, {p} %rows, {p} %order, {p} %out) nounwind {{"
        self.label("entry")
        highest = self.line(f"load double, {p} %order, align 8")
        last = self.line(f"fptosi double {highest} to i64")
        offset = self.line(f"mul i64 {self.line(f'sub i64 {last}, 1')}, {width}")
        top = self.place("%rows", offset)
        before = "entry"
        for first in range(0, n, LANES * GROUP // 2):
            before = self._horner(first, min(LANES * GROUP // 2, n - first), top, last, before)
        return "\n".join([head, *self.lines, "  ret void", "}", ""])

    def _horner(self, first: int, count: int, top: str, last: str, before: str) -> str:
        """Some coordinates; returns the label after them."""
        p, name = self.p, f"h{first}"
        parts = [(i, min(LANES, count - i)) for i in range(0, count, LANES)]
        zero, one = constant(0.0), constant(1.0)
        starts = self.line("fadd double %h, " + zero)
        powers = self.line(f"sitofp i64 {last} to double")
        self.jump(name)
        self.label(name)
        phis = [
            ("i64", "k", last, f"%{name}_k1"),
            ("double", "f", powers, f"%{name}_f1"),
            (p, "r", top, f"%{name}_r1"),
        ]
        for i, w in parts:
            phis += [
                (self.vector(w), f"c{i}", "zeroinitializer", f"%{name}_c{i}_1"),
                (self.vector(w), f"d{i}", "zeroinitializer", f"%{name}_d{i}_1"),
            ]
        for kind, what, begin, again in phis:
            self.lines.append(
                f"  %{name}_{what} = phi {kind} [ {begin}, %{before} ], [ {again}, %{name} ]"
            )
        for i, w in parts:
            kind = self.vector(w)
            h, k = self.splat(starts, w), self.splat(f"%{name}_f", w)
            row = self.load(f"%{name}_r", first + i, w)
            for what, term in (("c", row), ("d", self.line(f"fmul contract {kind} {row}, {k}"))):
                moved = self.line(f"fmul contract {kind} %{name}_{what}{i}, {h}")
                self.lines.append(f"  %{name}_{what}{i}_1 = fadd contract {kind} {term}, {moved}")
        self.lines += [
            f"  %{name}_k1 = sub i64 %{name}_k, 1",
            f"  %{name}_f1 = fsub double %{name}_f, {one}",
            f"  %{name}_r1 = getelementptr double, {p} %{name}_r, i64 -{self.series.width}",
        ]
        end = f"{name}_end"
        self.branch(self.line(f"icmp sgt i64 %{name}_k1, 0"), name, end)
        self.label(end)
        for i, w in parts:
            kind = self.vector(w)
            change = self.line(f"fmul {kind} %{name}_c{i}_1, {self.splat(starts, w)}")
            self.store(change, "%out", first + i, w)
            self.store(f"%{name}_d{i}_1", "%out", self.series.n + first + i, w)
        return end

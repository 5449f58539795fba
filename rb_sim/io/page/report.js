"use strict";
/* The report of an analysis: plots in sections; those over time share its axis, those over frequency theirs. */

const D = JSON.parse(document.getElementById("data").textContent);
const across = D.across.map(numbers);

/** Plots with one axis in common: a drag shows a span in all of them, the pointer its values. */
class Shared {
  constructor(unit) {
    this.unit = unit;
    this.plots = [];
    this.whole = [Infinity, -Infinity];
  }

  add(spec) {
    const lines = spec.lines.map((line) => ({ ...line, t: across[spec.across], y: numbers(line.y), exact: null }));
    const host = $(spec.section), { title, unit, scale, logarithmic, bounds } = spec;
    const plot = new Plot(host, { title, unit, scale, logarithmic, bounds, lines, across: this.unit },
      () => {}, (from, to) => this.zoom(from, to));
    const t = across[spec.across];
    this.whole = [Math.min(this.whole[0], t[0]), Math.max(this.whole[1], t[t.length - 1])];
    plot.front.addEventListener("pointermove", (event) => {
      const box = plot.front.getBoundingClientRect(), { left, right } = MARGIN;
      const s = (event.clientX - box.left - left) / (box.width - left - right);
      for (const each of this.plots) each.cursor(s >= 0 && s <= 1 ? each.from + s * (each.to - each.from) : null);
    });
    plot.front.addEventListener("pointerleave", () => this.plots.forEach((each) => each.cursor(null)));
    this.plots.push(plot);
  }

  zoom(from, to) {
    this.span = from === null ? this.whole : [from, to];
    this.draw();
  }

  draw() {
    for (const plot of this.plots) plot.draw(...this.span, null);
  }
}

const shared = { s: new Shared("s"), Hz: new Shared("Hz") };
for (const spec of D.plots) shared[spec.logarithmic === "xy" ? "Hz" : "s"].add(spec);
for (const each of Object.values(shared)) each.zoom(null, null);
window.addEventListener("resize", () => Object.values(shared).forEach((each) => each.draw()));

/** For tests and for the console of the browser. */
window.rb_sim = { shared };

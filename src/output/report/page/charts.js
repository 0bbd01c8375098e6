// Time series by uPlot: one chart per quantity, zoomed together, with a line at the instant shown.

import uPlot from "uplot";

const COLORS = ["--c0", "--c1", "--c2", "--c3", "--c4", "--c5", "--c6"];
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Formats a number with four digits. */
export function short(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const size = Math.abs(value);
  const rounded = Number(value.toPrecision(4));
  return size !== 0 && (size >= 1e6 || size < 1e-3) ? rounded.toExponential() : String(rounded);
}

/** Returns the power of 1000 in which a value has one to three digits before the point, and its prefix. */
function prefix(value) {
  const size = Math.abs(value);
  if (size === 0 || !Number.isFinite(size)) return [1, ""];
  const power = Math.max(-4, Math.min(4, Math.floor(Math.log10(size / 0.99995) / 3)));
  return [1000 ** power, ["p", "n", "µ", "m", "", "k", "M", "G", "T"][power + 4]];
}

/** Formats a value with four digits and the prefix of its unit; those without a unit as they are. */
export function engineering(value, unit) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!unit || unit === "-") return short(value);
  const [one, name] = prefix(value);
  return `${short(value / one)} ${name}${unit}`;
}

/** Returns the power of 1000 in which charts of some arrays count, and its prefix. */
function multiple(arrays) {
  const sizes = arrays.flatMap((array) => Array.from(array, Math.abs).filter(Number.isFinite));
  return prefix(sizes.reduce((most, size) => Math.max(most, size), 0));
}

export class Charts {
  /** `onTime` is called with the time (s) at which the user clicks. */
  constructor(host, charts, arrays, onTime) {
    [this.one, this.prefix] = multiple([arrays.row_times]);
    this.times = Array.from(arrays.row_times, (time) => time / this.one);
    this.plots = charts.map((chart, number) => this.#chart(host, chart, arrays, onTime, number === charts.length - 1));
    new ResizeObserver(() => this.#fit(host)).observe(host);
    window.addEventListener("beforeprint", () => this.#fit(host, 660));
    window.addEventListener("afterprint", () => this.#fit(host));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.plots.forEach((plot) => plot.redraw()));
  }

  #chart(host, chart, arrays, onTime, isLast) {
    const figure = document.createElement("figure");
    figure.tabIndex = 0;
    figure.setAttribute("role", "group");
    const values = chart.columns.map(({ array }) => arrays[array]);
    const [one, power] = chart.unit ? multiple(values) : [1, ""];
    const unit = power + (chart.unit ?? "");
    const time = `time (${this.prefix}s)`;
    const label = unit ? `${chart.title} (${unit})` : chart.title;
    figure.setAttribute("aria-label", `Chart of ${label} over time. Arrows move it, plus and minus zoom, 0 shows all.`);
    host.append(figure);
    const axis = (more) => ({
      stroke: () => style("--ink"), grid: { stroke: () => style("--line"), width: 1 }, ticks: { stroke: () => style("--line"), width: 1 },
      font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", ...more,
    });
    const series = chart.columns.map((column, i) => {
      const [color, dash] = column.style ?? [i, Math.floor(i / 2)];
      return {
        label: column.label, stroke: () => style(COLORS[color % COLORS.length]), width: 1.5, dash: DASHES[dash % DASHES.length],
        points: { show: false }, value: (_, value) => short(value),
      };
    });
    const plot = new uPlot({
      width: Math.max(host.clientWidth, 200), height: 210,
      title: label,
      scales: { x: { time: false } },
      axes: [axis({ label: isLast ? time : undefined, size: 30, values: (_, ticks) => ticks.map(short) }), axis({ size: 62, values: (_, ticks) => ticks.map(short) })],
      series: [{ label: time, value: (_, value) => short(value) }, ...series],
      cursor: { sync: { key: "time" }, drag: { x: true, y: false }, y: false },
      hooks: {
        setScale: [(plot, key) => key === "x" && this.#zoomed(plot)],
        draw: [(plot) => this.#rules(plot, (chart.rules ?? []).map((rule) => rule / one))],
        setSize: [() => this.mark(this.time)],
      },
    }, [this.times, ...values.map((array) => Array.from(array, (value) => (Number.isNaN(value) ? null : value / one)))], figure);
    const line = document.createElement("div");
    line.className = "now";
    plot.over.append(line);
    plot.now = line;
    let down = 0;
    plot.over.addEventListener("mousedown", (event) => (down = event.clientX));
    plot.over.addEventListener("click", (event) => {
      if (Math.abs(event.clientX - down) < 4) onTime(this.one * plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
    });
    figure.addEventListener("keydown", (event) => this.#key(plot, event));
    return plot;
  }

  /** Draws level lines, such as the heights of obstacles. */
  #rules(plot, rules) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = style("--ink");
    ctx.setLineDash([3, 4]);
    for (const value of rules) {
      const y = plot.valToPos(value, "y", true);
      if (!(y >= bbox.top && y <= bbox.top + bbox.height)) continue;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  #zoomed(plot) {
    if (this.zooming || !this.plots) return;
    this.zooming = true;
    const { min, max } = plot.scales.x;
    for (const other of this.plots) if (other !== plot) other.setScale("x", { min, max });
    this.zooming = false;
    queueMicrotask(() => this.mark(this.time));
  }

  zoom(min, max) {
    const [first, last] = [this.times[0], this.times[this.times.length - 1]];
    this.plots[0]?.setScale("x", { min: Math.max(min, first), max: Math.min(max, last) });
  }

  all() {
    this.zoom(-Infinity, Infinity);
  }

  #key(plot, event) {
    const { min, max } = plot.scales.x, span = max - min;
    const steps = { ArrowLeft: [-0.1, -0.1], ArrowRight: [0.1, 0.1], "+": [0.15, -0.15], "-": [-0.2, 0.2] };
    if (event.key === "0" || event.key === "Home") this.all();
    else if (steps[event.key]) this.zoom(min + steps[event.key][0] * span, max + steps[event.key][1] * span);
    else return;
    event.preventDefault();
  }

  /** Moves the lines to an instant, in s. */
  mark(time) {
    this.time = time;
    if (time === undefined) return;
    for (const plot of this.plots ?? []) {
      const at = plot.valToPos(time / this.one, "x");
      plot.now.hidden = !(at >= 0 && at <= plot.over.clientWidth);
      plot.now.style.transform = `translateX(${at}px)`;
    }
  }

  #fit(host, width = host.clientWidth) {
    if (width > 0) for (const plot of this.plots) plot.setSize({ width, height: 210 });
  }
}

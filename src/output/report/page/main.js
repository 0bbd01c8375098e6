// The page of a run: reads its numbers, and joins view, charts and table.

import "uplot/dist/uPlot.min.css";
import "./page.css";
import { decode } from "./data.js";
import { View } from "./view.js";
import { Charts, engineering } from "./charts.js";
import { sortable } from "./table.js";

const $ = (id) => document.getElementById(id);
/** Seconds in which a whole run is shown at ordinary speed. */
const DURATION = 15;

const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
document.documentElement.classList.add("js");
for (const table of document.querySelectorAll("table.sortable")) sortable(table);
for (const pictures of document.querySelectorAll("details.pictures")) pictures.open = false;
// Paper is white, also for readers in dark mode.
window.addEventListener("beforeprint", () => {
  document.documentElement.dataset.print = "";
  document.querySelectorAll("details").forEach((part) => (part.open = true));
});
window.addEventListener("afterprint", () => delete document.documentElement.dataset.print);
$("print")?.addEventListener("click", () => print());
$("save")?.addEventListener("click", () => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([$("scene-text").textContent], { type: "text/plain" }));
  link.download = "scene.toml";
  link.click();
});

function complain(why) {
  for (const place of document.querySelectorAll(".live")) place.classList.add("off");
  const note = $("trouble");
  note.hidden = false;
  note.textContent = `The moving view and the charts cannot be shown (${why}). The pictures below show the same run.`;
  for (const pictures of document.querySelectorAll("details.pictures")) pictures.open = true;
}

async function start() {
  const meta = JSON.parse($("meta").textContent);
  if (!("DecompressionStream" in window)) throw new Error("this browser has no DecompressionStream; a newer one has");
  const arrays = await decode($("data").textContent, meta.arrays);
  let player;
  const charts = new Charts($("charts"), meta.charts, arrays, (time) => player?.show(time));
  $("all").addEventListener("click", () => charts.all());
  if (arrays.frame_times) player = new Player(meta, arrays, charts);
  const byHash = () => {
    const time = Number(/^#t=([-+.\de]+)$/.exec(location.hash)?.[1] ?? NaN);
    if (Number.isNaN(time)) return false;
    player?.show(time);
    charts.mark(time);
    return true;
  };
  window.addEventListener("hashchange", byHash);
  const asked = byHash();
  if (player && !asked && !still) player.play();
  document.documentElement.dataset.ready = "yes";
}

/** Moves through the snapshots of a run. */
class Player {
  constructor(meta, arrays, charts) {
    Object.assign(this, { meta, arrays, charts, times: arrays.frame_times, place: 0, speed: 1 });
    this.view = new View($("view"), arrays);
    const n = arrays.x.length;
    this.w = new Float32Array(n);
    this.values = new Float32Array(n);
    this.heights = { floor: new Float32Array(n), ceiling: new Float32Array(n) };
    this.bolts = meta.bolts.map((bolt) => [...bolt, this.#nearest(bolt)]);
    this.ranges = this.#ranges();
    this.balls = arrays.balls.length / 4 / this.times.length;
    this.middle = this.#middle();
    this.#controls();
    this.draw();
  }

  /** Returns x, y, height and side of the balls near the plate at a place between frames. */
  #ballsAt(place) {
    const { balls, arrays, times, ranges } = this, [low, high] = ranges.deflection;
    const frame = Math.min(Math.floor(place), times.length - 1), next = Math.min(frame + 1, times.length - 1);
    const number = (at, ball, i) => arrays.balls[4 * (at * balls + ball) + i];
    const of = (ball) => [0, 1, 2, 3].map((i) => number(frame, ball, i) + (place - frame) * (number(next, ball, i) - number(frame, ball, i)));
    const far = 3 * Math.max(Math.abs(low), Math.abs(high), high - low);
    return Array.from({ length: balls }, (_, ball) => of(ball)).filter(([, , height]) => Math.abs(height) <= far);
  }

  /** Returns the shown point nearest to a place on the plate. */
  #nearest([x, y]) {
    const far = (p) => Math.hypot(this.arrays.x[p] - x, this.arrays.y[p] - y);
    return this.arrays.x.reduce((best, _, p) => (far(p) < far(best) ? p : best), 0);
  }

  /** Returns the least and largest value of each quantity over all frames. */
  #ranges() {
    const { deflection, von_mises } = this.arrays;
    const ranges = { deflection: deflection.range() };
    if (von_mises) ranges.von_mises = von_mises.range();
    const low = [Infinity, -Infinity];
    if (this.arrays.floor || this.arrays.ceiling) {
      for (let frame = 0; frame < this.times.length; frame++) {
        this.#gaps(frame);
        for (const gap of this.values) { if (gap < low[0]) low[0] = gap; if (gap > low[1]) low[1] = gap; }
      }
    }
    if (low[0] <= low[1]) ranges.gap = low;
    return ranges;
  }

  /** Computes the distance to the nearest obstacle at a place between frames into `values`. */
  #gaps(place) {
    const { arrays, heights, values, w } = this;
    arrays.deflection.at(place, w);
    for (const side of ["floor", "ceiling"]) if (arrays[side]) arrays[side].at(place, heights[side]);
    for (let p = 0; p < w.length; p++) {
      const below = arrays.floor ? w[p] - heights.floor[p] : NaN;
      const above = arrays.ceiling ? heights.ceiling[p] - w[p] : NaN;
      values[p] = Number.isNaN(below) ? above : Number.isNaN(above) ? below : Math.min(below, above);
    }
  }

  /** Drops obstacles too far from the plate to be shown; returns the height in the middle. */
  #middle() {
    const [low, high] = this.ranges.deflection, span = high - low;
    let [least, most] = [Math.min(low, 0), Math.max(high, 0)];
    for (const side of ["floor", "ceiling"]) {
      const [a, b] = this.arrays[side]?.range() ?? [NaN, NaN];
      const near = span <= 0 || (a >= low - 2 * span && b <= high + 2 * span);
      this.heights[side].near = near && !Number.isNaN(a);
      if (this.heights[side].near) [least, most] = [Math.min(least, a), Math.max(most, b)];
    }
    return (least + most) / 2;
  }

  #controls() {
    const { meta, ranges, times } = this;
    const slider = $("time");
    slider.max = times.length - 1;
    slider.addEventListener("input", () => { this.pause(); this.at(Number(slider.value)); });
    $("play").addEventListener("click", () => (this.timer ? this.pause() : this.play()));
    $("before").addEventListener("click", () => { this.pause(); this.at(Math.ceil(this.place) - 1); });
    $("after").addEventListener("click", () => { this.pause(); this.at(Math.floor(this.place) + 1); });
    $("view").addEventListener("keydown", (event) => {
      const keys = { " ": "play", ",": "before", ".": "after" };
      if (keys[event.key]) { event.preventDefault(); $(keys[event.key]).click(); }
    });
    const speed = $("speed");
    for (const factor of [0.1, 0.25, 0.5, 1, 2, 4]) {
      const slower = (DURATION / (times[times.length - 1] - times[0])) / factor;
      const words = slower >= 1 ? `${Number(slower.toPrecision(2))} times slower` : `${Number((1 / slower).toPrecision(2))} times faster`;
      speed.add(new Option(words, factor, factor === 1, factor === 1));
    }
    speed.addEventListener("change", () => (this.speed = Number(speed.value)));
    const color = $("color");
    for (const { name, label } of meta.colors) if (ranges[name]) color.add(new Option(label, name));
    color.addEventListener("change", () => this.draw());
    const scale = $("scale");
    for (const factor of meta.scales) scale.add(new Option(`×${factor}`, factor));
    scale.value = meta.scale;
    scale.addEventListener("change", () => this.draw());
    $("look").addEventListener("change", (event) => {
      const looks = { oblique: {}, side: { turn: 0, rise: 0 }, end: { turn: -Math.PI / 2, rise: 0 }, top: { turn: 0, rise: 1.5 } };
      this.view.look(looks[event.target.value]);
    });
    $("nearer").addEventListener("click", () => this.view.move(0, 0, 1.2));
    $("farther").addEventListener("click", () => this.view.move(0, 0, 1 / 1.2));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    for (const print of ["beforeprint", "afterprint"]) window.addEventListener(print, () => this.draw());
  }

  play() {
    if (this.place >= this.times.length - 1) this.place = 0;
    let last = performance.now();
    let time = this.time();
    const span = this.times[this.times.length - 1] - this.times[0];
    const tick = (now) => {
      time += ((now - last) / 1000) * this.speed * (span / DURATION);
      last = now;
      this.place = this.placeOf(time);
      this.draw();
      if (this.place >= this.times.length - 1) this.pause();
      else this.timer = requestAnimationFrame(tick);
    };
    this.timer = requestAnimationFrame(tick);
    this.#button("Pause");
  }

  pause() {
    cancelAnimationFrame(this.timer);
    this.timer = undefined;
    this.#button("Play");
    this.draw();
  }

  #button(word) {
    $("play").textContent = word;
  }

  /** Shows an instant, in s. */
  show(time) {
    this.pause();
    this.at(this.placeOf(time));
  }

  at(place) {
    this.place = Math.max(0, Math.min(place, this.times.length - 1));
    this.draw();
  }

  placeOf(time) {
    const { times } = this, last = times.length - 1;
    if (!(time > times[0])) return 0;
    if (time >= times[last]) return last;
    let frame = 0;
    for (let end = last; end - frame > 1; ) {
      const middle = (frame + end) >> 1;
      if (times[middle] <= time) frame = middle; else end = middle;
    }
    return frame + (time - times[frame]) / (times[frame + 1] - times[frame]);
  }

  time() {
    const { times, place } = this, frame = Math.min(Math.floor(place), times.length - 1);
    const next = times[Math.min(frame + 1, times.length - 1)];
    return times[frame] + (place - frame) * (next - times[frame]);
  }

  draw() {
    const { arrays, place, heights, ranges } = this;
    const by = $("color").value || "deflection";
    arrays.deflection.at(place, this.w);
    if (by === "gap") this.#gaps(place);
    else arrays[by].at(place, this.values);
    const wall = (side) => (heights[side].near ? arrays[side].at(place, heights[side]) : null);
    const frame = Math.round(place), ends = arrays.touch_ends;
    const touch = arrays.touch.subarray(frame > 0 ? ends[frame - 1] : 0, ends[frame]);
    const dark = matchMedia("(prefers-color-scheme: dark)").matches && document.documentElement.dataset.print === undefined;
    const [low, high] = ranges[by];
    this.view.show({
      w: this.w, values: this.values, range: [low, high > low ? high : low + 1], scale: Number($("scale").value) || 1,
      middle: this.middle, floor: wall("floor"), ceiling: wall("ceiling"), touch, bolts: this.bolts, balls: this.#ballsAt(place), ink: dark ? [0.85, 0.87, 0.9] : [0.15, 0.17, 0.2],
    });
    const time = this.time(), words = engineering(time, "s");
    const { label, unit } = this.meta.colors.find(({ name }) => name === by);
    const small = (value) => engineering(Math.abs(value) < 1e-4 * (high - low) ? 0 : value, unit);
    $("quantity").textContent = label;
    $("low").textContent = small(low);
    $("high").textContent = small(high);
    const nearest = this.times[frame], isBetween = !this.timer && Math.abs(nearest - time) > this.meta.step;
    const note = isBetween ? `, nearest snapshot: ${engineering(nearest, "s")}` : "";
    $("now").textContent = `t = ${words}${touch.length ? ", in contact" : ""}${note}`;
    const slider = $("time");
    slider.value = place;
    slider.setAttribute("aria-valuetext", words);
    this.charts.mark(time);
  }
}

start().catch((error) => complain(error.message));

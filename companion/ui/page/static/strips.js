// Altitude, speed, threat level and t_f over time.

import uPlot from "./vendor/uplot.js";
import { clock, span } from "./words.js";

const LIVE_S = 600; // shown of a running flight
const POINTS = 1200; // in a strip

const STRIPS = [
  { name: "Altitude, and the ground below where it is known", short: "Altitude", column: 3, colour: "--flown", say: (value) => `${value.toFixed(0)} m up`, hasGround: true },
  { name: "Airspeed", column: 4, colour: "--sub-goal", say: (value) => `${value.toFixed(1)} m/s` },
  { name: "Threat level", column: 5, colour: "--radar", say: (value) => value.toFixed(2), least: 0.2 },
  {
    name: "Until t_f: the earliest a pursuer could threaten the way", short: "Safe from pursuers for", column: 6, colour: "--dynamic",
    say: (value) => span(value), none: "always", least: 60,
  },
];

export class Strips {
  constructor(element, store, ground, onSeek) {
    this.element = element;
    this.store = store;
    this.ground = ground;
    this.onSeek = onSeek;
    this.plots = [];
    this.build();
    new ResizeObserver(() => this.resize()).observe(element);
  }

  build() {
    this.element.replaceChildren();
    this.plots = STRIPS.map((strip) => {
      const figure = document.createElement("figure");
      const caption = document.createElement("figcaption");
      const name = document.createElement("span");
      name.textContent = strip.short ?? strip.name;
      name.title = strip.name;
      const value = document.createElement("b");
      caption.append(name, value);
      const body = document.createElement("div");
      figure.append(caption, body);
      this.element.append(figure);
      const ink = (variable) => getComputedStyle(this.element).getPropertyValue(variable).trim();
      const axis = { stroke: () => ink("--muted"), grid: { stroke: () => ink("--line"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
      const plot = new uPlot(
        {
          width: 200,
          height: 96,
          cursor: { y: false, points: { show: false }, drag: { x: false, y: false } },
          legend: { show: false },
          padding: [6, 10, 0, 0],
          scales: { x: { time: false }, y: { range: (_, low, high) => rangeOf(low, high, strip.least) } },
          axes: [
            { ...axis, size: 20, gap: 2, space: 60, values: (_, marks) => marks.map((mark) => clock(mark - (this.store.begin || 0))) },
            { ...axis, size: 38, gap: 2, space: 26 },
          ],
          series: [
            {},
            { stroke: () => ink(strip.colour), width: 1.5, spanGaps: false, points: { show: false } },
            { stroke: () => ink("--contour"), width: 1.5, points: { show: false } },
          ],
          hooks: {
            draw: [(shown) => this.mark(shown)],
            ready: [
              (shown) =>
                shown.over.addEventListener("click", (event) => this.onSeek(shown.posToVal(event.offsetX, "x"))),
            ],
          },
        },
        [[], [], []],
        body,
      );
      return { strip, figure, body, value, plot };
    });
    this.resize();
  }

  resize() {
    const height = window.innerHeight < 700 ? 76 : 96;
    for (const { body, plot } of this.plots) {
      const width = Math.floor(body.getBoundingClientRect().width);
      if (width > 0) plot.setSize({ width, height });
    }
  }

  // A line where the recording is.
  mark(plot) {
    if (!this.store.isPlayed) return;
    const x = plot.valToPos(this.store.now, "x", true);
    const context = plot.ctx;
    context.save();
    context.strokeStyle = getComputedStyle(this.element).getPropertyValue("--ink");
    context.lineWidth = Math.round(window.devicePixelRatio || 1);
    context.beginPath();
    context.moveTo(x, plot.bbox.top);
    context.lineTo(x, plot.bbox.top + plot.bbox.height);
    context.stroke();
    context.restore();
  }

  draw() {
    const store = this.store;
    const all = store.rows;
    const from = store.isPlayed ? -Infinity : store.now - LIVE_S;
    let first = 0;
    while (first < all.length && all[first][0] < from) first++;
    const step = Math.max(1, Math.ceil((all.length - first) / POINTS));
    const rows = [];
    for (let row = first; row < all.length; row += step) rows.push(all[row]);
    const times = rows.map((row) => row[0]);
    let now = all.length - 1;
    while (now > 0 && all[now][0] > store.now) now--;
    for (const { strip, figure, value, plot } of this.plots) {
      const below = rows.map((row) => (strip.hasGround ? this.ground.at(row.slice(1)) : null));
      plot.setData([times, rows.map((row) => row[strip.column]), below]);
      const last = all[now]?.[strip.column];
      value.textContent = Number.isFinite(last) ? strip.say(last) : all.length && strip.none ? strip.none : "–";
      figure.setAttribute("aria-label", `${strip.name}: ${value.textContent}`);
      figure.setAttribute("role", "group");
    }
  }

  // Only the line of a recording has moved on.
  moveOn() {
    this.draw();
  }

  recolour() {
    for (const { plot } of this.plots) plot.redraw(false, true);
  }
}

function rangeOf(low, high, least = 0) {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [0, least || 1];
  if (least) return [0, Math.max(least, high * 1.08)];
  const pad = Math.max(1, (high - low) * 0.12);
  return [low - pad, high + pad];
}

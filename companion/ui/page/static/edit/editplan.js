// Plans: of the file, and with other prices and limits beside it.

import { posted } from "./asking.js";

const SOON_MS = 120; // after a change, so that a dragged slider does not ask for each of its places
const find = (id) => document.getElementById(id);
const whole = (unit) => (value) => (Number.isFinite(value) ? `${Math.round(value)} ${unit}` : "–");
const ROWS = [
  ["reaches the goal", (plan) => (plan.reaches_goal ? "yes" : "no")],
  ["J", (plan) => (Number.isFinite(plan.J_s) ? `${plan.J_s.toFixed(1)} s` : "–")],
  ["length", (plan) => whole("m")(plan.length_m)],
  ["arrival after", (plan) => whole("s")(plan.arrival_s)],
  ["seen by radars", (plan) => (Number.isFinite(plan.seen_s) ? `${plan.seen_s.toFixed(1)} s` : "–")],
  ["under threat", (plan) => whole("m")(plan.threatened_m)],
  ["highest threat level", (plan) => (Number.isFinite(plan.level_max) ? plan.level_max.toFixed(2) : "–")],
  ["in pursuers' reach", (plan) => (Number.isFinite(plan.pursued_s) ? `${plan.pursued_s.toFixed(1)} s` : "–")],
  ["free of collisions, Q", (plan) => (Number.isFinite(plan.quality) ? plan.quality.toFixed(3) : "–")],
  ["lowest", (plan) => whole("m up")(plan.lowest_m)],
  ["planned in", (plan) => `${Math.round(plan.took_s * 1000)} ms${plan.is_stopped ? ", stopped" : ""}`],
];

export class Plans {
  constructor(sliders, on) {
    this.on = on;
    this.file = null;
    this.other = null;
    this.wanted = {};
    this.settings = {};
    this.timers = {};
    this.figures = { planMs: [] };
    this.sliders = sliders;
    this.build();
  }

  build() {
    find("sliders").replaceChildren(...this.sliders.map((slider) => this.slider(slider)));
    find("drop").addEventListener("click", () => this.drop());
    find("take").addEventListener("click", () => {
      const changes = Object.entries(this.settings).map(([key, value]) => ({ do: "set", path: ["planning", key], value }));
      if (changes.length) this.on.take(changes);
      this.drop();
    });
  }

  slider({ key, low, high }) {
    const label = document.createElement("label");
    const input = document.createElement("input");
    const output = document.createElement("output");
    Object.assign(input, { type: "range", min: low, max: high, step: (high - low) / 100, id: `slider-${key}` });
    input.addEventListener("input", () => {
      const isNone = key === "seen_max_s" && Number(input.value) >= high;
      this.settings[key] = isNone ? null : Number(Number(input.value).toFixed(3));
      this.showSliders();
      this.soon("other");
    });
    label.append(key, input, output);
    return label;
  }

  // The file's values, unless others are tried.
  setFile(planning) {
    this.planning = planning ?? {};
    this.showSliders();
  }

  showSliders() {
    for (const { key, high, default: usual } of this.sliders) {
      const isTried = key in this.settings;
      const value = isTried ? this.settings[key] : (this.planning[key] ?? usual);
      const input = find(`slider-${key}`);
      input.value = value ?? high;
      input.nextElementSibling.textContent = value === null || value === undefined ? "no limit" : Number(value).toFixed(high > 50 ? 0 : 2);
      input.parentElement.dataset.changed = isTried ? "yes" : "no";
    }
  }

  drop() {
    this.settings = {};
    this.other = null;
    this.showSliders();
    this.showTable();
    this.on.changed();
  }

  // A change makes older plans pale until there is a newer one.
  outdate() {
    for (const side of ["file", "other"]) if (this[side]) this[side].isOld = true;
    this.on.changed();
  }

  soon(side) {
    clearTimeout(this.timers[side]);
    this.timers[side] = setTimeout(() => this.ask(side), SOON_MS);
  }

  renew() {
    this.soon("file");
    if (Object.keys(this.settings).length) this.soon("other");
  }

  async ask(side, isWhole = false) {
    const number = (this.wanted[side] = (this.wanted[side] ?? 0) + 1);
    const began = performance.now();
    if (!isWhole) find("planned").textContent = "planning …";
    const told = await posted("plan", { side, settings: side === "other" ? this.settings : {}, is_whole: isWhole });
    if (told.is_superseded || number !== this.wanted[side]) return;
    if (told.error) {
      find("planned").textContent = told.error;
      return;
    }
    if (!isWhole) this.figures.planMs.push(performance.now() - began);
    if (side === "other" && !Object.keys(this.settings).length) return;
    this[side] = { ...told, isOther: side === "other", isOld: false };
    find("planned").textContent = this.words(this[side]);
    this.showTable();
    this.on.changed();
    if (told.is_stopped && !isWhole) this.ask(side, true); // the rest of it, while nothing newer is asked for
  }

  words(plan) {
    if (!plan.path.length) return `No path: ${plan.status.replaceAll("_", " ")}. ${plan.notes.join(" ")}`;
    if (!plan.reaches_goal) return `The path does not reach the goal (${plan.status}). ${plan.notes.join(" ")}`;
    const unknown = this.on.hasUnknown() ? "Radars that are not known beforehand do not count: it learns of them in flight. " : "";
    return unknown + (plan.is_stopped ? "This is what half a second finds; it goes on." : "");
  }

  get shown() {
    return [this.file, this.other].filter((plan) => plan?.path.length);
  }

  showTable() {
    const sides = ["file", "other"].filter((side) => this[side]);
    const table = find("compared");
    table.replaceChildren();
    if (!sides.length) return;
    const head = table.createTHead().insertRow();
    const names = { file: "as in the file", other: "what if" };
    for (const side of ["", ...sides]) {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.dataset.side = side;
      cell.textContent = names[side] ?? "";
      head.append(cell);
    }
    const body = table.createTBody();
    for (const [words, figure] of ROWS) {
      const row = body.insertRow();
      const name = document.createElement("th");
      name.scope = "row";
      name.textContent = words;
      row.append(name);
      for (const side of sides) row.insertCell().textContent = figure(this[side]);
    }
  }
}

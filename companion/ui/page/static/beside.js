// Two recordings side by side, at the same instant of the flight.

import { clock, decisionWords } from "./words.js";

const find = (id) => document.getElementById(id);
const panes = [];
let at = 0;
let isPlaying = false;
let drawnAt = 0;

function said(decision) {
  return `${decision.kind}: ${decision.text}`;
}

function told(kind, more) {
  for (const pane of panes) pane.frame.contentWindow.postMessage({ kind, ...more }, location.origin);
}

function seek(stamp) {
  const firsts = panes.map((pane) => pane.first);
  const lasts = panes.map((pane) => pane.last);
  at = Math.min(Math.max(...lasts), Math.max(Math.min(...firsts), stamp));
  find("slider").value = at;
  find("clock").textContent = clock(at - Math.min(...firsts));
  told("seek", { at });
}

function setPlaying(now) {
  isPlaying = now;
  drawnAt = performance.now();
  find("play").textContent = now ? "❚❚" : "▶";
  find("play").setAttribute("aria-label", now ? "Pause" : "Play");
  if (now) requestAnimationFrame(turn);
}

function turn(now) {
  if (!isPlaying) return;
  seek(at + (Math.max(0, now - drawnAt) / 1000) * Number(find("speed").value));
  drawnAt = now;
  if (at >= Number(find("slider").max)) setPlaying(false);
  else requestAnimationFrame(turn);
}

function step(direction) {
  const stamps = panes.flatMap((pane) => pane.decisions.map((decision) => decision.stamp_s)).sort((a, b) => a - b);
  const next = direction > 0 ? stamps.find((stamp) => stamp > at + 0.05) : stamps.findLast((stamp) => stamp < at - 0.05);
  if (next !== undefined) seek(next);
}

// Decisions that only one of them made then, and the first of these.
function compare() {
  const [one, other] = panes;
  const key = (decision) => `${decision.stamp_s.toFixed(1)} ${said(decision)}`;
  const sets = [one, other].map((pane) => new Set(pane.decisions.map(key)));
  const apart = [
    one.decisions.filter((decision) => !sets[1].has(key(decision))),
    other.decisions.filter((decision) => !sets[0].has(key(decision))),
  ];
  panes.forEach((pane, index) => {
    pane.frame.contentWindow.postMessage({ kind: "differs", stamps: apart[index].map((decision) => decision.stamp_s) }, location.origin);
  });
  const first = apart.flat().sort((a, b) => a.stamp_s - b.stamp_s)[0];
  const about = `${one.name} | ${other.name}`;
  if (!first) {
    find("about").textContent = `${about}: the same decisions`;
    return;
  }
  const words = decisionWords(first);
  const begin = Math.min(one.first, other.first);
  find("about").textContent = `${about}: apart from ${clock(first.stamp_s - begin)} on (${words.head}: ${words.text})`;
  find("apart").hidden = false;
  find("apart").addEventListener("click", () => seek(first.stamp_s));
}

function begin() {
  const slider = find("slider");
  slider.min = Math.min(...panes.map((pane) => pane.first));
  slider.max = Math.max(...panes.map((pane) => pane.last));
  seek(Number(slider.min) + 5);
  compare();
}

window.addEventListener("message", (event) => {
  const pane = panes[Number(event.data.source)];
  if (event.origin !== location.origin || !pane) return;
  if (event.data.kind === "ready") {
    Object.assign(pane, { first: event.data.first, last: event.data.last, decisions: event.data.decisions });
    if (panes.every((one) => one.decisions)) begin();
  } else if (event.data.kind === "at" && panes.every((one) => one.decisions) && Math.abs(event.data.at - at) > 0.2 && event.data.at < pane.last && event.data.at > pane.first) {
    seek(event.data.at);
  }
});

find("play").addEventListener("click", () => setPlaying(!isPlaying));
find("before").addEventListener("click", () => step(-1));
find("after").addEventListener("click", () => step(1));
find("slider").addEventListener("input", (event) => seek(Number(event.target.value)));
let theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
function showTheme() {
  document.documentElement.dataset.theme = theme;
  find("theme").textContent = theme === "dark" ? "Light" : "Dark";
  told("theme", { name: theme });
}
find("theme").addEventListener("click", () => {
  theme = theme === "dark" ? "light" : "dark";
  showTheme();
});
document.documentElement.dataset.theme = theme;

const { sources } = await (await fetch("/sources.json")).json();
for (const [number, source] of sources.slice(0, 2).entries()) {
  const frame = document.createElement("iframe");
  frame.title = source.name;
  frame.src = `/?source=${number}&embedded=1`;
  panes.push({ name: source.name, frame });
  find("panes").append(frame);
}

// Where messages come from: the stream of a running flight, or a recording that is gone through here.

const CUMULATIVE = new Set(["/decision", "/plan", "/swap", "/snapshot"]);
const LATEST = ["/ownship", "/threat", "/tracks", "/standing", "/link", "/energy", "/trees", "/snapshot"];

export function split(line) {
  const space = line.indexOf(" ");
  return [line.slice(0, space), line.slice(space + 1)];
}

// A running flight. When the line breaks the browser connects again, and gets a new picture.
export class Live {
  constructor(source, store, told) {
    this.source = source;
    this.store = store;
    this.told = told;
    this.open();
  }

  open() {
    this.events = new EventSource(this.source.stream);
    this.events.addEventListener("snapshot", (event) => this.take(event, true));
    this.events.addEventListener("news", (event) => this.take(event, false));
    this.events.addEventListener("open", () => this.told.connected(true));
    this.events.addEventListener("error", () => {
      this.told.connected(false);
      if (this.events.readyState === EventSource.CLOSED) {
        // Refused for now, as by a proxy before the service is up again: asked again all the same.
        setTimeout(() => this.open(), 1000);
      }
    });
  }

  take(event, isWhole) {
    const heard = performance.now();
    for (const line of event.data.split("\n")) {
      const [topic, text] = split(line);
      this.store.apply(topic, JSON.parse(text));
    }
    this.told.news(heard, isWhole, Number(event.lastEventId));
  }
}

// A recording: lines by topic, parsed when they are shown.
export class Played {
  static async load(source, store) {
    const answer = await fetch(source.recording);
    if (!answer.ok) throw new Error(`${source.recording}: ${answer.status}`);
    return new Played(source, store, await answer.text());
  }

  constructor(source, store, text) {
    this.source = source;
    this.store = store;
    store.isPlayed = true;
    this.lines = new Map(); // topic: [[stamp, text]]
    this.order = []; // of what adds up: [stamp, topic, index]
    this.worlds = [];
    for (const line of text.split("\n")) {
      if (!line) continue;
      const [topic, rest] = split(line);
      const stamp = Number(/^\{"stamp_s":(-?[\d.e+-]+)/.exec(rest)?.[1] ?? NaN);
      if (!Number.isFinite(stamp)) continue;
      if (!this.lines.has(topic)) this.lines.set(topic, []);
      const lines = this.lines.get(topic);
      if (CUMULATIVE.has(topic)) this.order.push([stamp, topic, lines.length]);
      lines.push([stamp, rest]);
    }
    this.worlds = this.lines.get("/world") ?? [];
    this.decisions = (this.lines.get("/decision") ?? []).map(([, rest]) => JSON.parse(rest));
    const stamps = (this.lines.get("/ownship") ?? this.order).map(([stamp]) => stamp);
    this.first = stamps.length ? stamps[0] : 0;
    this.last = stamps.length ? stamps[stamps.length - 1] : 0;
    for (const decision of this.decisions) {
      this.first = Math.min(this.first, decision.stamp_s);
      this.last = Math.max(this.last, decision.stamp_s);
    }
    this.at = -Infinity;
    this.rows = this.history();
  }

  // The flown path over the whole flight, twice a second.
  history() {
    const store = this.store;
    store.reset();
    let place = 0;
    let level = 0;
    const levels = this.lines.get("/threat") ?? [];
    const rows = [];
    for (const [stamp, text] of this.lines.get("/ownship") ?? []) {
      if (rows.length && stamp - rows[rows.length - 1][0] < 0.45) continue;
      for (; place < this.order.length && this.order[place][0] <= stamp; place++) {
        const [, topic, index] = this.order[place];
        if (topic === "/plan" || topic === "/swap") store.apply(topic, JSON.parse(this.lines.get(topic)[index][1]));
      }
      while (level < levels.length && levels[level][0] <= stamp) level++;
      store.level = level ? JSON.parse(levels[level - 1][1]).level : null;
      const message = JSON.parse(text);
      const left = Number.isFinite(store.safeUntil) ? Math.max(0, store.safeUntil - stamp) : null;
      rows.push([stamp, ...message.position_enu_m, message.airspeed_m_s, store.level, left]);
    }
    store.reset();
    return rows;
  }

  // Index of the last line of a topic up to an instant; -1 before the first.
  index(topic, stamp) {
    const lines = this.lines.get(topic) ?? [];
    let low = -1;
    let high = lines.length - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (lines[middle][0] <= stamp) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  // Show an instant of the flight.
  seek(stamp) {
    const store = this.store;
    if (stamp < this.at) this.at = -Infinity;
    if (this.at === -Infinity) {
      store.reset();
      this.place = 0;
      this.shown = new Map();
    }
    const world = this.worlds[Math.max(0, this.index("/world", stamp))];
    if (world && this.shown.get("/world") !== world) {
      store.apply("/world", JSON.parse(world[1]));
      this.shown.set("/world", world);
    }
    for (; this.place < this.order.length && this.order[this.place][0] <= stamp; this.place++) {
      const [, topic, index] = this.order[this.place];
      store.apply(topic, topic === "/decision" ? this.decisions[index] : JSON.parse(this.lines.get(topic)[index][1]));
    }
    for (const topic of LATEST) {
      const index = this.index(topic, stamp);
      if (index < 0 || this.shown.get(topic) === index) continue;
      this.shown.set(topic, index);
      if (topic !== "/snapshot") store.apply(topic, JSON.parse(this.lines.get(topic)[index][1]));
    }
    this.at = stamp;
    store.now = stamp;
    store.rows = this.rows;
    store.begin = this.first;
    store.version.rows++;
  }
}

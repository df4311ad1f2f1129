// Puts the page together: where it looks, what it shows, and the keys.

import { GroundMap, LAYERS } from "./map.js";
import { Panels } from "./panels.js";
import { Live, Played } from "./source.js";
import { Store } from "./store.js";
import { SideView } from "./side.js";
import { Strips } from "./strips.js";
import { clock } from "./words.js";

const STRIPS_MS = 1000;
const PANELS_MS = 200;
const REACH_MS = 1000;
const FIELD_STEP_M = 10;
const find = (id) => document.getElementById(id);
const asked = new URLSearchParams(location.search);
const isEmbedded = asked.has("embedded");

// Figures that the page measures of itself; tests and the help read them.
const figures = { firstPictureMs: null, toPixelMs: [], frames: 0, frameMs: [], news: 0, errors: 0 };
window.companionPage = { figures };
window.addEventListener("error", () => figures.errors++);
window.addEventListener("unhandledrejection", () => figures.errors++);

function remembered(name, value) {
  try {
    if (value !== undefined) localStorage.setItem(name, value);
    return localStorage.getItem(name);
  } catch {
    return null; // storage may be forbidden
  }
}

class Page {
  constructor() {
    this.store = new Store();
    this.isConnected = false;
    this.heardAt = performance.now();
    this.waiting = []; // instants at which news came that is not drawn yet
    this.isDue = { map: true, panels: true, strips: true };
    this.drawnAt = { panels: -Infinity, strips: -Infinity, reach: -Infinity };
    this.theme(remembered("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"), false);
    this.map = new GroundMap(find("ground"), this.store, {
      changed: () => this.changed(),
      ground: () => this.renewed(),
      covered: () => (find("legend").open ? find("legend").offsetWidth + 10 : 0),
      following: (isFollowing) => find("follow").setAttribute("aria-pressed", isFollowing),
      hover: (text, x, y) => this.hover(text, x, y),
    });
    this.panels = new Panels(this.store, (stamp) => this.seek(stamp));
    this.side = new SideView(find("strips"), this.store, this.map.ground);
    this.strips = new Strips(find("strips"), this.store, this.map.ground, (stamp) => this.played && this.seek(stamp));
    this.buildLayers();
    this.listen();
  }

  async begin() {
    if (isEmbedded) document.body.classList.add("embedded");
    if (matchMedia("(min-width: 761px)").matches && !isEmbedded) find("legend").open = true;
    const answer = await fetch("/sources.json");
    const { sources, version } = await answer.json();
    this.programVersion = version;
    this.sources = sources;
    const number = Number(asked.get("source") ?? 0);
    this.source = sources[number] ?? sources[0];
    if (sources.length > 1) {
      find("beside").hidden = false;
      if (!asked.has("source")) {
        location.replace("/beside.html");
        return;
      }
    }
    if (this.source.stream) {
      this.live = new Live(this.source, this.store, {
        connected: (isConnected) => this.connected(isConnected),
        news: (heard, isWhole, sentMs) => this.news(heard, isWhole, sentMs),
      });
    } else {
      await this.play();
    }
    setInterval(() => this.look(), 500);
  }

  // --- a running flight

  connected(isConnected) {
    this.isConnected = isConnected;
    const badge = find("connection");
    badge.textContent = isConnected ? "live" : "no answer, trying again";
    badge.dataset.state = isConnected ? "safe" : "danger";
    this.changed({ panels: true });
  }

  news(heard, isWhole, sentMs) {
    this.heardAt = heard;
    figures.news++;
    this.waiting.push([heard, isWhole ? 0 : sentMs]);
    if (isWhole) {
      this.store.fillRows();
      this.connected(true);
      if (!this.map.hasMoved) this.map.fit();
      this.drawnAt = { panels: -Infinity, strips: -Infinity, reach: -Infinity }; // all of it at once
    }
    if (!Number.isFinite(this.store.begin) && this.store.rows.length) this.store.begin = this.store.rows[0][0];
    const { standing, version } = this.store;
    const key = `${standing?.mode}/${standing?.emergency}/${standing?.is_in_trouble}/${version.decisions}`;
    if (key !== this.standingKey) this.drawnAt.panels = -Infinity; // who flies, and what was decided, is told at once
    this.standingKey = key;
    this.changed({ panels: true, strips: true });
  }

  // --- a recording

  async play() {
    const badge = find("connection");
    badge.textContent = "reading the recording";
    this.played = await Played.load(this.source, this.store);
    badge.textContent = isEmbedded ? this.source.name : "recording";
    badge.title = this.source.name;
    this.isConnected = true;
    const { first, last } = this.played;
    const slider = find("slider");
    slider.min = first;
    slider.max = last;
    slider.step = Math.max(0.1, Math.round((last - first) / 200) / 10);
    find("transport").hidden = isEmbedded;
    find("of").textContent = clock(last - first);
    this.seek(Number(asked.get("t")) || first + Math.min(5, (last - first) / 10));
    this.drawMarks();
    if (isEmbedded) window.parent.postMessage({ kind: "ready", source: asked.get("source"), first, last, decisions: this.played.decisions }, location.origin);
  }

  seek(stamp) {
    const played = this.played;
    if (!played) return;
    const at = Math.min(played.last, Math.max(played.first, stamp));
    played.seek(at);
    const slider = find("slider");
    slider.value = at;
    slider.setAttribute("aria-valuetext", `${clock(at - played.first)} of ${clock(played.last - played.first)}`);
    this.heardAt = performance.now();
    this.changed({ panels: true, strips: true });
    if (isEmbedded && this.isTold !== at) window.parent.postMessage({ kind: "at", source: asked.get("source"), at }, location.origin);
  }

  setPlaying(isPlaying) {
    if (!this.played) return;
    if (isPlaying && this.played.at >= this.played.last) this.seek(this.played.first);
    this.isPlaying = isPlaying;
    this.playedAt = performance.now();
    const button = find("play");
    button.textContent = isPlaying ? "❚❚" : "▶";
    button.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    this.changed();
  }

  step(direction) {
    const stamps = (this.played?.decisions ?? []).map((decision) => decision.stamp_s);
    const at = this.played?.at ?? 0;
    const next = direction > 0 ? stamps.find((stamp) => stamp > at + 0.05) : stamps.findLast((stamp) => stamp < at - 0.05);
    if (next !== undefined) this.seek(next);
  }

  drawMarks() {
    const canvas = find("marks");
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.getBoundingClientRect().width;
    if (!this.played || width < 2) return;
    canvas.width = width * ratio;
    canvas.height = 10 * ratio;
    const context = canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    const { first, last } = this.played;
    for (const decision of this.played.decisions) {
      const isLoud = ["emergency", "no plan", "suspended", "rejected"].includes(decision.kind);
      context.fillStyle = style.getPropertyValue(isLoud ? "--danger" : decision.kind === "swap" ? "--flown" : "--muted");
      const x = ((decision.stamp_s - first) / Math.max(1, last - first)) * (canvas.width - 2 * ratio);
      context.fillRect(x, decision.kind === "keep" ? 5 * ratio : 0, 2 * ratio, 10 * ratio);
    }
  }

  // --- drawing

  changed(what = {}) {
    this.isDue ??= {};
    this.isDue.map = true;
    if (what.panels) this.isDue.panels = true;
    if (what.strips) this.isDue.strips = true;
    if (!this.frame) this.frame = requestAnimationFrame((now) => this.drawFrame(now));
  }

  drawFrame(now) {
    this.frame = null;
    const began = performance.now();
    if (this.isPlaying) {
      const passed = Math.min(0.5, (now - this.playedAt) / 1000) * Number(find("speed").value);
      this.playedAt = now;
      if (passed > 0) this.seek(this.played.at + passed);
      if (this.played.at >= this.played.last) this.setPlaying(false);
    }
    this.renewReach(now);
    if (this.isDue.panels && now - this.drawnAt.panels >= PANELS_MS) {
      this.isDue.panels = false;
      this.drawnAt.panels = now;
      const silence = this.played ? 0 : (performance.now() - this.heardAt) / 1000;
      this.panels.draw(this.isConnected, silence, Boolean(this.played));
      this.isAnswered = Boolean(this.store.world && this.store.ownship);
      this.renewGround();
      this.renewField();
      this.renewFloors();
    }
    if (this.isDue.strips && now - this.drawnAt.strips >= (this.played ? 100 : STRIPS_MS)) {
      this.isDue.strips = false;
      this.drawnAt.strips = now;
      if (!isEmbedded) {
        this.strips.draw();
        this.side.draw();
      }
    }
    this.isDue.map = false;
    if (this.solid?.isShown) this.solid.draw();
    else this.map.draw();
    this.noteFrame(performance.now() - began);
    if (this.isPlaying || this.isMeasuring) this.changed();
    else if (this.isDue.panels || this.isDue.strips) this.later();
  }

  // What is drawn less often than the map is drawn soon, too.
  later() {
    if (this.timer) return;
    this.timer = setTimeout(() => {
      this.timer = null;
      this.changed();
    }, PANELS_MS);
  }

  noteFrame(took) {
    figures.frames++;
    figures.frameMs.push(took);
    if (figures.frameMs.length > 600) figures.frameMs.splice(0, 300);
    const waiting = this.waiting;
    this.waiting = [];
    if (!waiting.length && figures.firstPictureMs !== null) return;
    // A message that is posted in a frame comes when that frame has been drawn.
    const channel = new MessageChannel();
    channel.port1.onmessage = () => {
      const wall = performance.timeOrigin + performance.now();
      for (const [, sentMs] of waiting) {
        if (!sentMs) continue;
        figures.toPixelMs.push(wall - sentMs);
        if (figures.toPixelMs.length > 2000) figures.toPixelMs.splice(0, 1000);
      }
      if (figures.firstPictureMs === null && this.isAnswered) figures.firstPictureMs = performance.now();
      channel.port1.close();
    };
    channel.port2.postMessage(null);
  }

  renewReach(now) {
    if (!this.map.layers.reach || !this.store.world?.bounds_m) return;
    const key = `${this.store.now}/${this.store.version.obstacles}/${this.store.world?.name}`;
    if (key === this.reachKey) return;
    if (now - this.drawnAt.reach < (this.isPlaying || this.live ? REACH_MS : 150)) {
      this.isDue.panels = true; // so that it is looked at again soon
      return;
    }
    this.reachKey = key;
    this.drawnAt.reach = now;
    this.map.reach.renew(this.store, key);
  }

  // The radars' field at the height that is flown, from the service.
  async renewField() {
    const { world, ownship } = this.store;
    if (!world?.radars?.length || (!this.map.layers.field && !this.solid?.isShown)) return;
    const up = ownship?.position_enu_m[2] ?? world.start_enu_m[2];
    const height = FIELD_STEP_M * Math.round(up / FIELD_STEP_M);
    const key = `${height}/${world.name}`;
    if (key === this.fieldKey) return;
    this.fieldKey = key;
    try {
      const answer = await fetch(`${this.source.field}/${height}`);
      if (answer.ok) {
        const field = await answer.json();
        if (field.is_later) {
          this.fieldKey = null;
          setTimeout(() => this.changed({ panels: true }), 500);
          return;
        }
        this.map.setField(field);
        this.solid?.setField(field);
      }
    } catch {
      this.fieldKey = null; // the service is away; asked again when it is back
    }
  }

  // From which height on each radar sees, for the view from the side.
  async renewFloors() {
    const { world } = this.store;
    const key = `${world?.name}/${JSON.stringify(world?.origin)}/${JSON.stringify(world?.bounds_m)}`;
    if (isEmbedded || !this.source?.field || !world?.terrain || !world.radars?.length || key === this.floorsKey) return;
    this.floorsKey = key;
    try {
      const answer = await fetch(this.source.field.replace("/field/", "/floors/"));
      const told = answer.ok ? await answer.json() : {};
      if (told.is_later) {
        this.floorsKey = null;
        setTimeout(() => this.changed({ panels: true }), 500);
        return;
      }
      this.side.setFloors(told.radars ?? []);
      this.changed({ strips: true });
    } catch {
      this.floorsKey = null; // the service is away; asked again when it is back
    }
  }

  // What the service has of the ground about the mission.
  async renewGround() {
    const { world } = this.store;
    const key = `${world?.name}/${JSON.stringify(world?.origin)}/${JSON.stringify(world?.bounds_m)}`;
    // A mission file with a map has heights where no file of the ground was named.
    const address = this.source?.ground ?? (world?.terrain ? this.source?.field?.replace("/field/", "/ground/") : null);
    if (!address || !world?.bounds_m || key === this.groundKey) return;
    this.groundKey = key;
    try {
      const answer = await fetch(address);
      if (answer.ok) this.map.ground.set(await answer.json());
      else this.groundKey = null;
    } catch {
      this.groundKey = null; // the service is away; asked again when it is back
    }
  }

  // Pictures of the ground have come.
  renewed() {
    const { ground } = this.map;
    const has = `${ground.has("tiles")}${ground.has("relief")}`;
    if (has !== this.hasGround) {
      this.hasGround = has;
      this.buildLayers();
    }
    find("credit").hidden = !ground.credit;
    find("credit").textContent = ground.credit;
    this.changed({ panels: true, strips: true });
  }

  // Now and then, whatever comes or does not.
  look() {
    if (this.live) this.changed({ panels: true });
    if (find("keys").open) this.tellFigures();
  }

  hover(text, x, y) {
    const box = find("hover");
    box.hidden = !text;
    if (!text) return;
    box.textContent = text;
    box.style.left = `${Math.min(x + 14, find("map").clientWidth - 240)}px`;
    box.style.top = `${y + 14}px`;
  }

  // --- what can be switched

  buildLayers() {
    const group = find("layers");
    group.replaceChildren(
      ...LAYERS.filter(([name]) => this.map.ground.has(name)).map(([name, words]) => {
        const label = document.createElement("label");
        const box = document.createElement("input");
        box.type = "checkbox";
        box.id = `layer-${name}`;
        box.checked = this.map.layers[name];
        box.addEventListener("change", () => this.show(name, box.checked));
        const swatch = document.createElement("canvas");
        swatch.setAttribute("aria-hidden", "true");
        this.map.swatch(name, swatch);
        label.append(box, swatch, words);
        return label;
      }),
    );
  }

  show(name, isShown) {
    this.map.layers[name] = isShown;
    find(`layer-${name}`).checked = isShown;
    this.solid?.changed();
    this.changed({ panels: true });
  }

  theme(name, isKept = true) {
    document.documentElement.dataset.theme = name;
    find("theme").textContent = name === "dark" ? "Light" : "Dark";
    if (isKept) remembered("theme", name);
    this.map?.recolour();
    this.solid?.recolour();
    this.strips?.recolour();
    if (this.map) {
      this.buildLayers();
      this.drawMarks();
    }
  }

  async toggleSolid() {
    const isShown = !this.solid?.isShown;
    if (isShown && !this.solid) {
      try {
        const { SolidView } = await import("./view3d.js");
        this.solid = new SolidView(find("solid"), this.store, this.map);
      } catch (error) {
        find("solid-why").hidden = false;
        find("solid-why").textContent = `No 3D here: ${error.message}`;
        return;
      }
      this.solid.setField(this.map.field);
    }
    this.solid.isShown = isShown;
    find("solid").hidden = !isShown;
    find("ground").hidden = isShown;
    const button = find("view");
    button.setAttribute("aria-pressed", isShown);
    button.textContent = isShown ? "Map" : "3D";
    find("legend").open = false;
    if (isShown) this.solid.resize();
    this.changed({ panels: true });
  }

  tellFigures() {
    const toPixel = [...figures.toPixelMs].sort((a, b) => a - b);
    const frame = [...figures.frameMs].sort((a, b) => a - b);
    const middle = (values) => (values.length ? values[Math.floor(values.length / 2)].toFixed(1) : "–");
    const memory = performance.memory ? `, ${(performance.memory.usedJSHeapSize / 1e6).toFixed(0)} MB in use` : "";
    find("figures").textContent =
      `Version ${this.programVersion}. First picture after ${Math.round(figures.firstPictureMs ?? NaN)} ms; ` +
      `from the service to the screen ${middle(toPixel)} ms; a picture takes ${middle(frame)} ms${memory}.`;
  }

  listen() {
    const clicks = {
      nearer: () => (this.solid?.isShown ? this.solid.zoom(0.8) : this.map.zoom(1.35)),
      farther: () => (this.solid?.isShown ? this.solid.zoom(1.25) : this.map.zoom(1 / 1.35)),
      fit: () => {
        this.map.setFollowing(false);
        this.map.fit();
        this.solid?.fit();
        this.changed();
      },
      follow: () => this.map.setFollowing(!this.map.isFollowing),
      view: () => this.toggleSolid(),
      theme: () => this.theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
      beside: () => location.assign("/beside.html"),
      help: () => {
        this.tellFigures();
        find("keys").showModal();
      },
      play: () => this.setPlaying(!this.isPlaying),
      before: () => this.step(-1),
      after: () => this.step(1),
    };
    for (const [id, act] of Object.entries(clicks)) find(id).addEventListener("click", act);
    find("legend").addEventListener("toggle", () => this.map.hasMoved || this.map.fit());
    find("slider").addEventListener("input", (event) => this.seek(Number(event.target.value)));
    window.addEventListener("resize", () => this.drawMarks());
    document.addEventListener("keydown", (event) => this.key(event, clicks));
    window.addEventListener("message", (event) => {
      if (event.origin !== location.origin || !this.played) return;
      if (event.data.kind === "seek") {
        this.isTold = Math.min(this.played.last, Math.max(this.played.first, event.data.at));
        this.seek(event.data.at);
      } else if (event.data.kind === "theme") this.theme(event.data.name, false);
      else if (event.data.kind === "differs") {
        this.panels.differing = new Set(event.data.stamps);
        this.changed({ panels: true });
      }
    });
  }

  key(event, clicks) {
    if (event.ctrlKey || event.altKey || event.metaKey || find("keys").open) return;
    const onControl = event.target.closest?.("input, select, button, summary");
    const far = event.shiftKey ? 30 : 5;
    const acts = {
      3: clicks.view,
      "+": clicks.nearer,
      "=": clicks.nearer,
      "-": clicks.farther,
      f: clicks.fit,
      c: clicks.follow,
      d: clicks.theme,
      t: () => {
        const isShown = !this.map.layers.tree;
        this.show("tree", isShown);
        this.show("threatTree", isShown);
      },
      "?": clicks.help,
      "[": clicks.before,
      "]": clicks.after,
      " ": onControl ? null : clicks.play,
      ArrowLeft: onControl ? null : () => this.played && this.seek(this.played.at - far),
      ArrowRight: onControl ? null : () => this.played && this.seek(this.played.at + far),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  // Draw without a pause for so many seconds, with the view moving; frames a second, and what one took.
  async measure(seconds) {
    const before = { centre: [...this.map.centre], scale: this.map.scale };
    figures.frameMs = [];
    const began = performance.now();
    const first = figures.frames;
    this.isMeasuring = true;
    await new Promise((done) => {
      const turn = () => {
        const passed = (performance.now() - began) / 1000;
        this.map.centre = [before.centre[0] + (20 * Math.sin(passed * 3)) / this.map.scale, before.centre[1]];
        this.changed();
        if (passed < seconds) requestAnimationFrame(turn);
        else done();
      };
      turn();
    });
    this.isMeasuring = false;
    const passed = (performance.now() - began) / 1000;
    Object.assign(this.map, before);
    this.changed();
    const took = [...figures.frameMs].sort((a, b) => a - b);
    return { perSecond: (figures.frames - first) / passed, frameMs: took[Math.floor(took.length / 2)], worstMs: took.at(-1) };
  }
}

const page = new Page();
window.companionPage.page = page;
page.begin();

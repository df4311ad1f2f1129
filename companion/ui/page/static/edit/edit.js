// The editor: what is selected, drawn and changed, between the server, the map, the numbers and the plans.

import { LAYERS } from "../map.js";
import { Store } from "../store.js";
import { got, posted } from "./asking.js";
import { Flight } from "./editflight.js";
import { Form } from "./editform.js";
import { EditMap } from "./editmap.js";
import { Plans } from "./editplan.js";
import { TOOLS, isTyping, moved, newElement, worldOf } from "./elements.js";

const find = (id) => document.getElementById(id);
const figures = { firstPictureMs: null, errors: 0, changeMs: [], planMs: [] };
const GROUND_MS = 700; // after a change: shadows of radars are computed after the plan, not beside it
const SHOWN = ["flown", "mission", "tracks", "field", "radars", "obstacles", "relief", "tiles"];

window.addEventListener("error", () => figures.errors++);
window.addEventListener("unhandledrejection", () => figures.errors++);

class Editor {
  constructor(tables, state) {
    this.store = new Store();
    this.tables = tables;
    this.elements = [];
    this.selected = null;
    this.corner = this.cornerKey = null;
    this.tool = null;
    this.drawing = [];
    this.waiting = Promise.resolve();
    this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    this.map = new EditMap(find("ground"), this.store, {
      changed: () => this.changed(),
      ground: () => this.showCredit(),
      covered: () => 0,
      following: () => {},
      hover: (text, x, y) => this.hover(text, x, y),
    });
    for (const [name] of LAYERS) this.map.layers[name] = SHOWN.includes(name);
    this.form = new Form(find("numbers"), tables.keys, (changes) => this.change(changes));
    this.planning = new Plans(tables.sliders, {
      changed: () => this.changed(),
      take: (changes) => this.change(changes),
      hasUnknown: () => this.elements.some((one) => one.kind === "radars" && one.values.known_beforehand === false),
    });
    figures.planMs = this.planning.figures.planMs;
    this.flight = new Flight(this.store, { changed: () => this.changed() });
    this.buildTools();
    this.listen();
    this.take(state);
    this.map.begin(this);
    this.map.fit();
    this.buildLayers();
    this.groundTimer = setTimeout(() => this.renewGround(), GROUND_MS);
  }

  // --- what the server says

  take(state) {
    this.state = state;
    const path = this.selected ? JSON.stringify(this.selected.path) : null;
    this.elements = state.elements.map((one) => ({ ...one, faults: faultsOf(state, one.path) }));
    const bounds = state.sections.bounds;
    const absent = state.absent.map((kind) => [kind, {}]); // A number by hand makes such a section.
    this.sections = [...Object.entries(state.sections), ...absent].map(([kind, values]) => {
      const path = kind ? kind.split(".") : [];
      const isAbsent = state.absent.includes(kind);
      return { path, kind, name: kind || "the file itself", values, faults: faultsOf(state, path, !kind), isSection: true, isAbsent };
    });
    const own = this.sections.find((one) => one.kind === "bounds");
    if (own && state.bounds_m) own.box_m = state.bounds_m.slice(0, 4);
    else if (own) own.kind = "bounds-wrong";
    this.hasBounds = Boolean(bounds && state.bounds_m);
    this.selected = path === null ? null : ([...this.elements, ...this.sections].find((one) => JSON.stringify(one.path) === path) ?? null);
    this.showWorld();
    this.show();
    this.planning.setFile(state.sections.planning);
  }

  showWorld() {
    const world = worldOf(this.state, this.elements, this.store.world);
    this.store.world = world;
    this.store.obstacles = null;
    this.store.version.world = (this.store.version.world ?? 0) + 1;
    this.changed();
  }

  show() {
    const { state } = this;
    find("mission").textContent = state.sections[""]?.name ?? "Mission";
    find("about").textContent = state.file;
    document.title = `${state.is_changed ? "● " : ""}${state.sections[""]?.name ?? "Mission"} – editor`;
    const standing = find("standing");
    const count = state.faults.length;
    standing.textContent = count ? `${count} error${count > 1 ? "s" : ""}` : state.is_changed ? "not saved yet" : "saved";
    standing.dataset.state = count ? "danger" : state.is_changed ? "unknown" : "safe";
    find("undo").disabled = !state.can_undo;
    find("redo").disabled = !state.can_redo;
    find("save").disabled = !state.is_changed;
    find("plan").disabled = find("fly").disabled = count > 0;
    this.showFaults();
    this.showChosen();
  }

  showFaults() {
    const { faults } = this.state;
    const list = find("faults");
    if (!faults.length) {
      const line = document.createElement("li");
      line.textContent = "The mission is valid.";
      list.replaceChildren(line);
      return;
    }
    list.replaceChildren(
      ...faults.map((fault) => {
        const line = document.createElement("li");
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = `${fault.key}: got ${fault.got}`;
        const more = document.createElement("small");
        more.textContent = `line ${fault.line ?? "–"}; expected ${fault.expected}`;
        button.append(more);
        button.addEventListener("click", () => this.goTo(fault.path));
        line.append(button);
        return line;
      }),
    );
  }

  showChosen() {
    const list = find("chosen");
    const option = (one) => {
      const made = document.createElement("option");
      made.value = JSON.stringify(one.path);
      made.textContent = one.name + (one.faults.length ? " – wrong" : "");
      return made;
    };
    const none = document.createElement("option");
    none.value = "";
    none.textContent = "nothing";
    const [absent, sections] = [true, false].map((isAbsent) => this.sections.filter((one) => one.isAbsent === isAbsent));
    const groups = [["Elements", this.elements], ["Sections", sections], ["Not in the file yet", absent]].map(([label, entries]) => {
      const group = document.createElement("optgroup");
      group.label = label;
      group.append(...entries.filter((one) => one.isSection !== true || one.kind !== "start").map(option));
      return group;
    });
    list.replaceChildren(none, ...groups);
    list.value = this.selected ? JSON.stringify(this.selected.path) : "";
    find("remove").disabled = !this.canRemove(this.selected);
    const mates = this.elements.filter((one) => one.kind === this.selected?.kind && one.path.length > 1);
    find("earlier").hidden = find("later").hidden = this.selected?.kind !== "goals" || mates.length < 2;
    find("earlier").disabled = mates[0] === this.selected;
    find("later").disabled = mates[mates.length - 1] === this.selected;
    const way = { degrees: "latitude and longitude", utm: "UTM", metres: "metres" }[this.selected?.written];
    find("written").textContent = way ? `Line ${this.selected.line} of the file; its place is written in ${way}, and stays so.` : "";
    this.form.show(this.selected);
  }

  goTo(path) {
    const entries = [...this.elements, ...this.sections].filter((one) => one.path.every((part, index) => part === path[index]));
    const one = entries.sort((a, b) => b.path.length - a.path.length)[0];
    if (!one) return;
    this.select(one);
    if (one.place_m && !this.isSeen(one.place_m)) this.map.centre = one.place_m.slice(0, 2);
    find(`number-${path[one.path.length] ?? ""}`)?.focus();
  }

  isSeen(place) {
    const [x, y] = this.map.pixelOf(place);
    return x > 0 && y > 0 && x < this.map.width && y < this.map.height;
  }

  plans() {
    return this.planning.shown;
  }

  // --- changes

  // One after the other, as they are made; each is one step to undo.
  send(name, body) {
    this.waiting = this.waiting.then(async () => {
      const began = performance.now();
      const told = await posted(name, { ...body, number: this.state.number });
      find("refused").textContent = told.error ?? "";
      if (told.error) {
        this.take(told.key === "number" ? await got("state") : this.state);
        return false;
      }
      const isOther = told.number !== this.state.number;
      this.take(told);
      figures.changeMs.push(performance.now() - began);
      if (isOther) this.afterChange();
      return true;
    });
    return this.waiting;
  }

  change(changes) {
    return this.send("change", { changes });
  }

  afterChange() {
    this.planning.outdate();
    if (find("always").checked && !this.state.faults.length) this.planning.renew();
    clearTimeout(this.groundTimer);
    this.groundTimer = setTimeout(() => this.renewGround(), GROUND_MS);
  }

  select(one, corner = null, key = null) {
    if (this.selected === one && this.corner === corner) return;
    this.selected = one;
    this.corner = corner;
    this.cornerKey = key ?? (one?.polygon_enu_m ? "polygon_enu_m" : "route_enu_m");
    this.showChosen();
    this.changed();
  }

  // While something is dragged, it is drawn where it would be.
  preview(drag) {
    if (!drag) {
      this.take(this.state);
      return;
    }
    const shown = moved(drag);
    this.elements = this.elements.map((one) => (one.path.join() === shown.path.join() ? shown : one));
    this.sections = this.sections.map((one) => (shown.isSection && one.path.join() === shown.path.join() ? shown : one));
    this.selected = shown;
    if (shown.isSection) {
      this.changed();
      return;
    }
    this.showWorld();
  }

  drop(drag, isClick) {
    const [east, north] = drag.by;
    const { element } = drag;
    const key = drag.part;
    if (isClick || (!east && !north)) {
      this.take(this.state);
      if (drag.between === undefined) this.select(this.selected, drag.corner ?? null, key);
      return;
    }
    if (drag.part === "body") this.change([{ do: "move", path: element.path, value: drag.by }]);
    else if (drag.part === "side") this.change([{ do: "bound", path: ["bounds"], value: moved(drag).box_m }]);
    else if (drag.part === "radius" || drag.part === "course") {
      const name = drag.part === "course" ? "course_deg" : drag.key;
      this.change([{ do: "set", path: [...element.path, name], value: moved(drag).values[name] }]);
    } else if (drag.between !== undefined) {
      const at = [drag.origin[0] + east, drag.origin[1] + north].map((value) => Number(value.toFixed(1)));
      this.change([{ do: "add", path: [...element.path, key, drag.between], value: at }]);
    } else this.change([{ do: "move", path: [...element.path, key, drag.corner], value: drag.by }]);
  }

  nudge(event) {
    const size = event.shiftKey ? 1 : event.altKey ? 100 : 10;
    const way = { ArrowLeft: [-size, 0], ArrowRight: [size, 0], ArrowUp: [0, size], ArrowDown: [0, -size] }[event.key];
    const one = this.selected;
    if (!way || !one || one.isSection) return;
    event.preventDefault();
    const isCorner = this.corner !== null && one[this.cornerKey]?.[this.corner];
    const path = isCorner ? [...one.path, this.cornerKey, this.corner] : one.path;
    this.change([{ do: "move", path, value: way }]);
  }

  canRemove(one) {
    if (one?.isSection) return !one.isAbsent && this.state.optional.includes(one.kind);
    return Boolean(one) && one.kind !== "start";
  }

  remove() {
    const one = this.selected;
    if (!this.canRemove(one)) return;
    const isCorner = this.corner !== null && one[this.cornerKey]?.[this.corner];
    const path = isCorner ? [...one.path, this.cornerKey, this.corner] : one.path;
    if (!isCorner) this.select(null);
    this.corner = null;
    this.change([{ do: "remove", path }]);
  }

  // Goals are flown to in the order of the file.
  exchange(by) {
    const { path } = this.selected;
    const number = path[path.length - 1] + by;
    this.change([{ do: "exchange", path, value: by }]).then((isDone) => isDone && this.goTo([...path.slice(0, -1), number]));
  }

  // --- drawing

  setTool(tool) {
    this.tool = tool;
    this.drawing = [];
    find("ground").classList.toggle("drawing", Boolean(tool));
    for (const button of find("draw").children) button.setAttribute("aria-pressed", String(button.dataset.tool === tool?.name));
    find("hint").textContent = tool?.hint ?? "";
    this.changed();
  }

  draw(place, closes) {
    if (closes) {
      this.closeDrawing();
      return;
    }
    const last = this.drawing[this.drawing.length - 1];
    if (last && last[0] === place[0] && last[1] === place[1]) return; // the second click of a double one
    this.drawing.push(place);
    if (this.tool.isArea || this.tool.isLine) this.changed();
    else this.closeDrawing();
  }

  closeDrawing() {
    const { tool, drawing } = this;
    if (!tool || drawing.length < (tool.isArea ? 3 : 1)) return;
    const made = newElement(tool, drawing, this);
    this.setTool(null);
    if (!made) return;
    this.change(made.changes).then((isDone) => {
      if (isDone && made.path) this.goTo(made.path);
    });
  }

  buildTools() {
    find("draw").replaceChildren(
      ...TOOLS.map((tool) => {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = tool.words;
        button.dataset.tool = tool.name;
        button.title = tool.hint;
        button.setAttribute("aria-pressed", "false");
        button.addEventListener("click", () => this.setTool(this.tool === tool ? null : tool));
        return button;
      }),
    );
  }

  buildLayers() {
    find("layers").replaceChildren(
      ...LAYERS.filter(([name]) => SHOWN.includes(name) && this.map.ground.has(name)).map(([name, words]) => {
        const label = document.createElement("label");
        const box = document.createElement("input");
        box.type = "checkbox";
        box.checked = this.map.layers[name];
        box.addEventListener("change", () => {
          this.map.layers[name] = box.checked;
          this.changed();
        });
        const swatch = document.createElement("canvas");
        swatch.setAttribute("aria-hidden", "true");
        this.map.swatch(name, swatch);
        label.append(box, swatch, words);
        return label;
      }),
    );
  }

  // --- ground and the radars' field, of the mission as it is now

  async renewGround() {
    if (this.state.faults.length) return;
    const { number } = this.state;
    const height = Math.round((this.elements.find((one) => one.kind === "start")?.place_m?.[2] ?? 0) / 10) * 10;
    if (!this.hasGround) {
      const ground = await got("ground");
      if (ground.tiles || ground.heights) {
        this.map.ground.set(ground);
        this.buildLayers();
      }
      this.hasGround = true;
    }
    for (let field = { is_later: true }; field.is_later && number === this.state.number; ) {
      field = await got(`field/${height}`);
      if (number !== this.state.number) return;
      if (!field.is_later) this.map.setField(field.levels ? field : null);
      else await new Promise((done) => setTimeout(done, 150));
    }
  }

  showCredit() {
    const { credit } = this.map?.ground ?? {};
    find("credit").hidden = !credit;
    find("credit").textContent = credit ?? "";
    this.changed();
  }

  // --- the page

  listen() {
    const clicks = {
      undo: () => this.send("undo"),
      redo: () => this.send("redo"),
      save: () => this.save(),
      plan: () => this.planning.renew(),
      fly: () => this.flight.fly(),
      remove: () => this.remove(),
      earlier: () => this.exchange(-1),
      later: () => this.exchange(1),
      nearer: () => this.map.zoom(1.4),
      farther: () => this.map.zoom(1 / 1.4),
      fit: () => this.map.fit(),
      theme: () => this.setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
      help: () => find("keys").showModal(),
    };
    for (const [id, act] of Object.entries(clicks)) find(id).addEventListener("click", act);
    find("chosen").addEventListener("change", (event) => {
      const path = event.target.value;
      this.select(path ? [...this.elements, ...this.sections].find((one) => JSON.stringify(one.path) === path) : null);
    });
    const keys = { p: clicks.plan, y: clicks.fly, f: clicks.fit, "+": clicks.nearer, "-": clicks.farther, d: clicks.theme, "?": clicks.help,
      Delete: clicks.remove, Backspace: clicks.remove, Enter: () => this.closeDrawing(), Escape: () => this.escape(), n: () => this.step(1), b: () => this.step(-1) };
    window.addEventListener("keydown", (event) => {
      const isControl = event.ctrlKey || event.metaKey;
      const name = event.key.toLowerCase();
      if (isControl && ["z", "y", "s"].includes(name)) {
        if (name !== "s" && isTyping(event) && event.target.value !== event.target.dataset.written) return;
        event.preventDefault();
        if (name === "s") this.blurred().then(() => this.save());
        else this.send(name === "y" || event.shiftKey ? "redo" : "undo");
        return;
      }
      if (isControl || isTyping(event) || find("keys").open) return;
      if (event.key.startsWith("Arrow")) this.nudge(event);
      else if (keys[event.key] && !(event.key === "Enter" && event.target.closest?.("button"))) keys[event.key]();
    });
    window.addEventListener("beforeunload", (event) => {
      if (this.state.is_changed) event.preventDefault();
    });
  }

  // A number that is being typed is taken first.
  async blurred() {
    document.activeElement?.blur?.();
    await this.waiting;
  }

  async save() {
    await this.waiting;
    const isDone = await this.send("save");
    if (isDone || !find("refused").textContent.includes("changed meanwhile")) return;
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Load the file anew";
    button.addEventListener("click", () => this.send("reload"));
    find("refused").append(" ", button);
  }

  escape() {
    if (this.tool) this.setTool(null);
    else if (this.map.drag) this.map.cancel();
    else this.select(null);
  }

  step(by) {
    const at = this.elements.indexOf(this.selected);
    const next = this.elements[(at + by + this.elements.length) % this.elements.length];
    if (next) this.select(next);
  }

  setTheme(name) {
    document.documentElement.dataset.theme = name;
    find("theme").textContent = name === "dark" ? "Light" : "Dark";
    this.map?.recolour();
  }

  hover(text, x, y) {
    const box = find("hover");
    box.hidden = !text;
    box.textContent = text ?? "";
    if (text) Object.assign(box.style, { left: `${Math.min(x + 14, this.map.width - 240)}px`, top: `${y + 14}px` });
  }

  changed() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.map?.draw();
      figures.firstPictureMs ??= performance.now();
    });
  }
}

// Faults of an element or section; of the file itself only those of its own keys.
function faultsOf(state, path, isOwn = false) {
  return state.faults.filter((fault) => (isOwn ? fault.path.length < 2 : path.every((part, index) => part === fault.path[index])));
}

const [tables, state] = await Promise.all([got("tables"), got("state")]);
const editor = new Editor(tables, state);
window.companionPage = { figures, editor, page: editor };
if (!state.faults.length) editor.planning.renew();

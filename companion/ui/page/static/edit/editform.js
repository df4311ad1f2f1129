// The numbers of what is selected, to be written by hand, with what the check says beside each.

const OPEN_MAX = 14; // a section with more keys shows those of the file first

// Text as it is typed: numbers, lists as "60, 160", corners as "0, 10; 5, 20".
export function typed(value) {
  if (value === null || value === undefined) return "";
  if (Array.isArray(value)) return value.map(typed).join(value.some(Array.isArray) ? "; " : ", ");
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}

// The value of a typed text; the value that stands there says what is a list.
export function valueOf(text, like, allowed) {
  const one = (part) => {
    const word = part.trim();
    if (word === "true" || word === "false") return word === "true";
    return word !== "" && Number.isFinite(Number(word)) && !allowed.startsWith("text") ? Number(word) : word;
  };
  const isLines = Array.isArray(like) ? like.some(Array.isArray) : allowed.startsWith("list of [");
  if (isLines) return text.split(";").filter((part) => part.trim()).map((part) => part.split(",").map(one));
  if (Array.isArray(like) || /^(list|2 ×)/.test(allowed)) return text.split(",").filter((part) => part.trim()).map(one);
  return one(text);
}

export class Form {
  constructor(group, tables, on) {
    this.group = group;
    this.tables = tables;
    this.on = on;
  }

  show(one) {
    const focused = document.activeElement?.closest("#numbers") ? document.activeElement.id : null;
    this.group.replaceChildren();
    if (!one) return;
    const table = this.tables[one.kind] ?? [];
    const entries = flat(one.values ?? {});
    const isElsewhere = new Set(entries.map(([path]) => path[0]).concat(hidden(one.values ?? {})));
    const rows = entries.map(([path, value]) => this.row(one, path, value, table.find((key) => key.key === meant(path[0]))));
    const more = table.filter((key) => !isElsewhere.has(key.key)).map((key) => this.row(one, [key.key], undefined, key));
    this.group.append(...rows);
    if (more.length) {
      const rest = document.createElement("details");
      const summary = document.createElement("summary");
      summary.textContent = `${more.length} more, with their defaults`;
      rest.append(summary, ...more);
      rest.open = more.length + rows.length <= OPEN_MAX;
      this.group.append(rest);
    }
    if (focused) document.getElementById(focused)?.focus();
  }

  row(one, path, value, key) {
    const entry = document.createElement("div");
    entry.className = "entry";
    const name = path.join(".");
    const label = document.createElement("label");
    const allowed = key?.allowed ?? "";
    const input = chooser(allowed) ?? document.createElement("input");
    input.id = `number-${name}`;
    label.htmlFor = input.id;
    label.textContent = name;
    label.title = input.title = [key?.meaning, allowed && `Allowed: ${allowed}.`].filter(Boolean).join(" ");
    input.value = input.dataset.written = typed(value);
    input.autocomplete = "off";
    if (value === undefined) input.placeholder = (key?.default ?? "").replaceAll("`", "");
    input.addEventListener("change", () => this.write(one, path, value, input.value, allowed));
    const unit = document.createElement("span");
    unit.className = "unit";
    unit.textContent = key?.unit ?? "";
    entry.append(label, input, unit);
    for (const fault of (one.faults ?? []).filter((found) => isOf(found.path.slice(one.path.length), path))) {
      entry.dataset.state = "danger";
      const words = document.createElement("p");
      words.textContent = `expected ${fault.expected}`;
      entry.append(words);
    }
    return entry;
  }

  write(one, path, before, text, allowed) {
    const whole = [...one.path, ...path];
    if (text.trim() === "") {
      if (before !== undefined) this.on([{ do: "remove", path: whole }]);
      return;
    }
    this.on([{ do: "set", path: whole, value: valueOf(text, before, allowed) }]);
  }
}

// Keys of a section; those of a UTM place one by one.
function flat(values) {
  return Object.entries(values).flatMap(([key, value]) =>
    value !== null && typeof value === "object" && !Array.isArray(value) ? Object.entries(value).map(([inner, entry]) => [[key, inner], entry]) : [[[key], value]],
  );
}

// Keys that stand for others which are written.
function hidden(values) {
  const found = "latitude_deg" in values || "utm" in values ? ["east_m", "north_m"] : [];
  return found.concat(Object.keys(values).map(meant));
}

function meant(key) {
  return key.replace(/_lat_lon_deg$/, "_enu_m");
}

// Whether a fault is about a key: places are told in metres, however they are written.
function isOf(fault, path) {
  const key = String(fault[0] ?? "");
  if (key === path[0] || key === meant(path[0])) return path.length < 2 || fault[1] === undefined || fault[1] === path[1];
  return (key === "east_m" && ["latitude_deg", "utm"].includes(path[0])) || (key === "north_m" && path[0] === "longitude_deg");
}

// A list where only some words are allowed.
function chooser(allowed) {
  const words = [...allowed.matchAll(/`([^`]+)`/g)].map((found) => found[1]);
  if (words.length < 2 || !/^`[^`]+`( or `[^`]+`)+$/.test(allowed)) return null;
  const select = document.createElement("select");
  for (const word of ["", ...words]) {
    const option = document.createElement("option");
    option.value = word;
    option.textContent = word || "–";
    select.append(option);
  }
  return select;
}

// A flight in the simulator, in the same view: message by message as it goes, and any moment of it afterwards.

import { clock, decisionWords } from "../words.js";
import { got, posted } from "./asking.js";

const POLL_MS = 120;
const find = (id) => document.getElementById(id);

export class Flight {
  constructor(store, on) {
    this.store = store;
    this.on = on;
    this.lines = [];
    this.isFlying = false;
    find("stop").addEventListener("click", () => posted("stop"));
    find("forget").addEventListener("click", () => this.forget());
    find("moment").addEventListener("input", (event) => this.seek(Number(event.target.value)));
  }

  async fly() {
    if (this.isFlying) return;
    this.forget();
    find("flown").textContent = "beginning …";
    const told = await posted("fly", { pace: Number(find("pace").value) });
    if (told.error) {
      find("flown").textContent = told.error;
      return;
    }
    this.isFlying = true;
    find("stop").disabled = false;
    let since = 0;
    while (this.isFlying) {
      const news = await got(`flight/${since}`);
      since = news.next;
      this.take(news.lines);
      if (news.is_over) this.end(news);
      else await new Promise((done) => setTimeout(done, POLL_MS));
    }
  }

  take(lines) {
    for (const line of lines) {
      const at = line.indexOf(" ");
      const entry = [line.slice(0, at), JSON.parse(line.slice(at + 1))];
      this.lines.push(entry);
      this.store.apply(...entry);
    }
    if (!lines.length) return;
    find("flown").textContent = `flying: ${clock(this.store.now)}`;
    this.tellDecisions();
    this.on.changed();
  }

  end({ measures, fault }) {
    this.isFlying = false;
    find("stop").disabled = true;
    find("forget").disabled = !this.lines.length;
    const stamps = this.lines.map(([, message]) => message.stamp_s).filter(Number.isFinite);
    const slider = find("moment");
    slider.hidden = !stamps.length;
    Object.assign(slider, { min: stamps[0] ?? 0, max: stamps[stamps.length - 1] ?? 1 });
    slider.value = slider.max;
    find("flown").textContent = fault || (Object.keys(measures ?? {}).length ? measured(measures) : "stopped");
    this.on.changed();
  }

  // The flight up to a moment.
  seek(moment) {
    const world = this.store.world;
    this.store.reset();
    this.store.world = world;
    for (const [topic, message] of this.lines) if (!(message.stamp_s > moment)) this.store.apply(topic, message);
    this.store.version.world = performance.now();
    this.tellDecisions();
    this.on.changed();
  }

  forget() {
    const world = this.store.world;
    this.store.reset();
    this.store.world = world;
    this.store.version.world = performance.now();
    this.lines = [];
    find("told").replaceChildren();
    find("flown").textContent = "";
    find("forget").disabled = find("moment").hidden = true;
    this.on.changed();
  }

  tellDecisions() {
    const rows = this.store.decisions.slice(-30).reverse();
    find("told").replaceChildren(
      ...rows.map((decision) => {
        const line = document.createElement("li");
        line.textContent = `${clock(decision.stamp_s)} ${decisionWords(decision).head}: ${decision.text ?? ""}`;
        return line;
      }),
    );
  }
}

function measured(measures) {
  const words = [measures.success ? "The goal was reached" : measures.collision ? "It hit something" : "The goal was not reached"];
  words.push(`after ${Math.round(measures.flight_s)} s`);
  const threatened = measures.seconds_in_reach_and_sight;
  words.push(threatened > 0 ? `under threat for ${threatened.toFixed(1)} s` : "never under threat");
  if (Number.isFinite(measures.min_obstacle_clearance_m)) words.push(`${measures.min_obstacle_clearance_m.toFixed(0)} m clear of obstacles`);
  return `${words.join(", ")}.`;
}

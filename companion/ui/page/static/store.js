// What is known of the flight at the moment that is shown, built up from the recorder's messages.

const ROWS_MAX = 4000; // of the flown path and the strips
const DECISIONS_MAX = 500;
const PLANS_MAX = 40;

export class Store {
  constructor() {
    this.isPlayed = false; // then the rows are the whole flight's, and kept elsewhere
    this.reset();
  }

  reset() {
    this.world = null;
    this.now = NaN;
    this.begin = NaN;
    this.ownship = null;
    this.tracks = [];
    this.level = null;
    this.standing = null;
    this.link = null;
    this.energy = null;
    this.known = null;
    this.obstacles = null;
    this.candidate = null;
    this.trees = null;
    this.mission = null; // the last exchange that ended with ours being flown
    this.plan = null; // the plan that it carries out
    this.plans = new Map();
    this.decisions = [];
    this.rows = []; // [time, east, north, up, speed, level, seconds until t_f or null]
    this.safeUntil = undefined; // t_f of what is flown: a clock reading, null for never, undefined if unknown
    this.safeMarks = []; // [since when, t_f], in order
    this.version = { world: 0, obstacles: 0, trees: 0, decisions: 0, rows: 0, plan: 0 };
  }

  apply(topic, message) {
    const stamp = message.stamp_s;
    if (Number.isFinite(stamp) && topic !== "/world" && !(stamp < this.now)) this.now = stamp;
    switch (topic) {
      case "/reset":
        this.reset();
        break;
      case "/world":
        this.world = message;
        this.version.world++;
        break;
      case "/history":
        this.rows = message.rows.map((row) => [...row, null]);
        this.version.rows++;
        break;
      case "/ownship":
        this.ownship = message;
        this.addRow(message);
        break;
      case "/threat":
        this.level = message.level;
        break;
      case "/tracks":
        this.tracks = message.tracks;
        break;
      case "/track": // of one that was detected just now; the next "/tracks" tells all
        this.tracks = [...this.tracks.filter((track) => track.identity !== message.track.identity), message.track];
        break;
      case "/snapshot":
        this.known = message.known_threats;
        if (message.obstacles) {
          this.obstacles = message.obstacles;
          this.version.obstacles++;
        }
        break;
      case "/plan":
        this.notePlan(message);
        break;
      case "/trees":
        this.trees = message;
        this.version.trees++;
        break;
      case "/swap":
        this.noteSwap(message);
        break;
      case "/decision":
        this.decisions.push(message);
        if (this.decisions.length > DECISIONS_MAX) this.decisions.splice(0, this.decisions.length - DECISIONS_MAX);
        this.version.decisions++;
        break;
      case "/standing":
        this.standing = message;
        break;
      case "/link":
        this.link = message;
        break;
      case "/energy":
        this.energy = message;
        break;
    }
  }

  addRow(message) {
    if (this.isPlayed) return;
    const last = this.rows[this.rows.length - 1];
    if (last && message.stamp_s - last[0] < 0.45) return;
    const left = Number.isFinite(this.safeUntil) ? Math.max(0, this.safeUntil - message.stamp_s) : null;
    this.rows.push([message.stamp_s, ...message.position_enu_m, message.airspeed_m_s, this.level, left]);
    if (this.rows.length > ROWS_MAX) this.rows = this.rows.filter((_, index) => index % 2 === 0);
    this.version.rows++;
  }

  notePlan(message) {
    this.plans.set(message.number, message);
    if (this.plans.size > PLANS_MAX) this.plans.delete(this.plans.keys().next().value);
    if (message.flown_pursuit && "first_s" in message.flown_pursuit) this.noteSafe(message.stamp_s, message.flown_pursuit.first_s);
    if (!message.path) return; // of before this page was opened, for the strips
    this.candidate = message.path.length ? message : null;
    this.version.plan++;
  }

  noteSwap(message) {
    if (message.outcome !== "flown") return;
    const plan = this.plans.get(message.plan_number);
    if (plan?.pursuit) this.noteSafe(message.stamp_s, plan.pursuit.first_s);
    if (!message.waypoints_enu_m) return;
    this.mission = message;
    if (plan?.path) this.plan = plan;
    this.version.plan++;
  }

  // What is told again to one that comes later is older than what he knows.
  noteSafe(stamp, until) {
    const last = this.safeMarks.at(-1);
    if (last && stamp < last[0]) return;
    this.safeUntil = until;
    this.safeMarks.push([stamp, until]);
    if (this.safeMarks.length > ROWS_MAX) this.safeMarks.splice(0, ROWS_MAX / 2);
  }

  // Complete the rows of before this page was opened.
  fillRows() {
    let mark = 0;
    for (const row of this.rows) {
      while (mark < this.safeMarks.length && this.safeMarks[mark][0] <= row[0]) mark++;
      const until = mark ? this.safeMarks[mark - 1][1] : undefined;
      row[6] = Number.isFinite(until) ? Math.max(0, until - row[0]) : null;
    }
    this.version.rows++;
  }

  // The last plan made, where it is not what is flown.
  get candidateOnly() {
    return this.candidate && this.candidate.number !== this.plan?.number ? this.candidate : null;
  }

  // All that is in the way: the mission file's obstacles, and fences as the service knows them.
  get walls() {
    return this.obstacles ?? this.world?.obstacles ?? [];
  }

  isFence(wall) {
    return wall.name.startsWith("fence ") && !(this.world?.obstacles ?? []).some((one) => one.name === wall.name);
  }

  isKnown(radar) {
    return this.known === null || this.known.includes(radar.name);
  }

  // Whether the mission of ours is what is flown now.
  get isFlown() {
    return !this.standing || ["active", "lost"].includes(this.standing.mode);
  }

  // Rows of the flown plan from where the aircraft is, for so many seconds.
  ahead(seconds) {
    const plan = this.plan;
    if (!plan || !this.ownship || !this.isFlown) return [];
    const rows = plan.path;
    const [east, north, up] = this.ownship.position_enu_m;
    let nearest = 0;
    let least = Infinity;
    for (let row = 0; row < rows.length; row++) {
      const away = (rows[row][1] - east) ** 2 + (rows[row][2] - north) ** 2 + (rows[row][3] - up) ** 2;
      // Where the way crosses itself, the row whose time fits is meant.
      const late = 4 * Math.max(0, Math.abs(rows[row][0] - this.now) - 5) ** 2;
      if (away + late < least) {
        least = away + late;
        nearest = row;
      }
    }
    const found = [];
    for (let row = nearest; row < rows.length && rows[row][0] - rows[nearest][0] <= seconds; row++) {
      found.push({ row, in_s: rows[row][0] - rows[nearest][0], place: rows[row].slice(1, 4), covariance: plan.covariances_m2?.[row] });
    }
    return found;
  }

  // The highest threat level of what is left of the flown plan, and in how many seconds it is first more than `least`.
  threatAhead(least) {
    const levels = this.ahead(Infinity).map((entry) => [this.plan.threat_levels[entry.row] ?? 0, entry.in_s]);
    if (!levels.length) return null;
    const begin = levels.find(([level]) => level > least);
    return { level: Math.max(...levels.map(([level]) => level)), in_s: begin ? begin[1] : null };
  }

  // The other members of the team.
  get others() {
    return (this.standing?.team?.members ?? []).filter((member) => !member.is_own);
  }

  // Whether the goals of the mission file are divided among the members.
  get isShared() {
    return Boolean(this.standing?.team?.flown);
  }

  isFlownGoal(number) {
    return this.standing.team.flown.includes(number + 1);
  }

  // The goals of the team where it shares them, else those of this aircraft.
  get allGoals() {
    return this.isShared ? (this.world?.goals ?? []) : this.goals;
  }

  get goalNames() {
    const goals = this.allGoals;
    if (!this.isShared) return goals.map((_, number) => (goals.length > 1 ? `goal ${number + 1}` : "goal"));
    const { members, flown } = this.standing.team;
    return goals.map((_, number) => {
      const owner = members.find((member) => member.goals.includes(number + 1));
      const whose = flown.includes(number + 1) ? ", flown" : owner ? `, system ${owner.system}` : "";
      return `goal ${number + 1}${whose}`;
    });
  }

  get goals() {
    return this.standing?.goals?.length ? this.standing.goals : (this.world?.goals ?? []);
  }
}

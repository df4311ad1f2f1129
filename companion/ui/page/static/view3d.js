// The same flight in three dimensions: east is x, up is y, south is z.

import {
  AmbientLight, BufferGeometry, CanvasTexture, Color, ConeGeometry, DirectionalLight, DoubleSide, EdgesGeometry,
  ExtrudeGeometry, Float32BufferAttribute, Group, Line2, LineBasicMaterial, LineGeometry, LineMaterial, LineSegments, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, OrbitControls, PerspectiveCamera, PlaneGeometry, Scene, Shape,
  SphereGeometry, SRGBColorSpace, Vector3, WebGLRenderer,
} from "./vendor/three.js";
import { fieldPicture } from "./map.js";
import { trackName } from "./words.js";

const PICTURE = 2048; // pixels of the ground, along its longer side
const AROUND = 0.3; // of the bounds' longer side it is drawn beyond them
const GRID = 193; // points of its surface along each side

const at = (place, lift = 0) => new Vector3(place[0], (place[2] ?? 0) + lift, -place[1]);

function dispose(object) {
  object.traverse((part) => {
    part.geometry?.dispose();
    for (const material of [part.material ?? []].flat()) {
      material.map?.dispose();
      material.dispose();
    }
  });
}

export class SolidView {
  constructor(element, store, map) {
    this.element = element;
    this.store = store;
    this.map = map;
    this.isShown = false;
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    element.append(this.renderer.domElement);
    this.renderer.domElement.setAttribute("role", "img");
    this.renderer.domElement.setAttribute("aria-label", "The flight in three dimensions; the answers beside it say the same in words");
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(45, 1, 1, 100000);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = Math.PI / 2 - 0.02;
    this.controls.addEventListener("change", () => map.on.changed());
    this.light = new DirectionalLight(0xffffff, 1.6);
    this.ambient = new AmbientLight(0xffffff, 1.5);
    this.scene.add(this.light, this.ambient);
    this.groups = {};
    this.keys = {};
    new ResizeObserver(() => this.resize()).observe(element);
    this.resize();
  }

  get ink() {
    return this.map.ink;
  }

  resize() {
    const width = this.element.clientWidth;
    const height = this.element.clientHeight;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.map.on.changed();
  }

  recolour() {
    this.keys = {};
  }

  changed() {
    this.keys = {};
  }

  setField(field) {
    this.field = field?.levels ? field : null;
    delete this.keys.field;
  }

  // Look at the whole world from the south.
  fit() {
    const bounds = this.store.world?.bounds_m;
    if (!bounds) return;
    const [west, east, south, north] = bounds;
    const size = Math.max(east - west, north - south);
    this.controls.target.set((west + east) / 2, 0, -(south + north) / 2);
    this.camera.position.set((west + east) / 2 - 0.2 * size, 0.78 * size, -(south + north) / 2 + 0.72 * size);
    this.camera.near = size / 2000;
    this.camera.far = size * 8;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.isFitted = this.store.world.name;
  }

  zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
  }

  // Make a group anew where what it shows has changed.
  renew(name, key, make) {
    if (this.keys[name] === key) return;
    this.keys[name] = key;
    if (this.groups[name]) {
      this.scene.remove(this.groups[name]);
      dispose(this.groups[name]);
    }
    this.groups[name] = new Group();
    make(this.groups[name]);
    this.scene.add(this.groups[name]);
  }

  line(group, places, colour, { dashed = false, opacity = 1, width = 1.5, isOnTop = false } = {}) {
    if (places.length < 2) return;
    const geometry = new LineGeometry().setPositions(places.flatMap((place) => at(place).toArray()));
    const material = new LineMaterial({
      color: new Color(colour), transparent: opacity < 1 || isOnTop, opacity, linewidth: width, dashed, dashSize: 60, gapSize: 40,
      depthTest: !isOnTop,
    });
    const line = new Line2(geometry, material);
    if (dashed) line.computeLineDistances();
    if (isOnTop) line.renderOrder = 5;
    group.add(line);
  }

  // A way, and faintly what walls hide of it, and its shadow on the ground.
  way(group, places, colour, look = {}) {
    this.line(group, places, colour, { width: 3, ...look });
    this.line(group, places, colour, { ...look, width: 2, opacity: 0.3, isOnTop: true });
    this.line(group, places.map((place) => [place[0], place[1], this.groundAt(place) + 2]), colour, { opacity: 0.3 });
  }

  groundAt(place) {
    return (this.map.layers.relief ? this.map.ground.at(place) : null) ?? this.ground;
  }

  draw() {
    const { store } = this;
    if (!store.world?.bounds_m) return;
    if (this.isFitted !== store.world.name) this.fit();
    this.ground = 0; // where no height is known
    this.scene.background = new Color(this.ink.ground);
    const layers = this.map.layers;
    const look = `${document.documentElement.dataset.theme}/${store.world.name}/${store.version.world}`;
    this.renew("ground", `${look}/${this.map.ground.version}/${layers.relief}/${layers.tiles}`, (group) => this.makeGround(group));
    this.renew("world", `${look}/${this.isDrawn}/${store.version.obstacles}/${layers.obstacles}/${layers.fences}`, (group) => this.makeWorld(group));
    this.renew("radars", `${look}/${store.known}/${layers.radars}`, (group) => layers.radars && this.makeRadars(group));
    this.renew("field", `${look}/${this.field?.height_m}/${layers.field}`, (group) => layers.field && this.makeField(group));
    this.renew("trees", `${look}/${store.version.trees}/${layers.tree}/${layers.threatTree}`, (group) => this.makeTrees(group));
    const { standing, version } = store;
    const handed = `${layers.operator}/${JSON.stringify(standing?.operator_enu_m)}/${JSON.stringify(standing?.handback?.way_enu_m)}/${layers.returns}/${JSON.stringify(standing?.returns?.way_enu_m)}/${standing?.mode}`;
    this.renew("ways", `${look}/${version.plan}/${layers.mission}/${layers.candidate}/${handed}`, (group) => this.makeWays(group));
    this.renew("goals", `${look}/${version.trees}/${layers.horizon}`, (group) => layers.horizon && this.makeSubGoals(group));
    this.renew("moving", `${look}/${store.now}`, (group) => this.makeMoving(group));
    if (this.map.isFollowing && store.ownship) {
      const place = at(store.ownship.position_enu_m);
      const moved = place.clone().sub(this.controls.target);
      this.controls.target.copy(place);
      this.camera.position.add(moved);
    }
    this.light.position.set(this.controls.target.x - 4000, 8000, this.controls.target.z + 3000);
    this.renderer.render(this.scene, this.camera);
    this.writeLabels();
  }

  // Names beside what moves, and the goals.
  writeLabels() {
    const { store } = this;
    const rows = store.allGoals.map((goal, number) => [goal, store.goalNames[number], "goal"]);
    for (const radar of store.world.radars ?? []) rows.push([radar.position_enu_m, radar.name, "radar"]);
    for (const track of store.tracks) rows.push([track.position_enu_m, trackName(track, store.world), "dynamic"]);
    if (store.ownship) rows.push([store.ownship.position_enu_m, `${store.ownship.position_enu_m[2].toFixed(0)} m up`, "flown"]);
    const box = this.element.querySelector("#labels");
    while (box.children.length < rows.length) box.append(document.createElement("span"));
    while (box.children.length > rows.length) box.lastChild.remove();
    for (const [index, [place, text, colour]] of rows.entries()) {
      const seen = at(place).project(this.camera);
      const label = box.children[index];
      label.hidden = seen.z > 1 || Math.abs(seen.x) > 1 || Math.abs(seen.y) > 1;
      label.textContent = text;
      label.style.color = this.ink[colour];
      label.style.left = `${((seen.x + 1) / 2) * this.element.clientWidth + 10}px`;
      label.style.top = `${((1 - seen.y) / 2) * this.element.clientHeight - 8}px`;
    }
  }

  makeWorld(group) {
    const { store, ink } = this;
    const [west, east, south, north] = store.world.bounds_m;
    const size = Math.max(east - west, north - south);
    if (!this.isDrawn) {
      const floor = new Mesh(new PlaneGeometry(east - west, north - south), new MeshBasicMaterial({ color: ink.soft }));
      floor.rotation.x = -Math.PI / 2;
      floor.position.set((west + east) / 2, this.ground - size / 2000, -(south + north) / 2);
      group.add(floor);
    }
    const step = 10 ** Math.floor(Math.log10(size / 4));
    const points = [];
    for (let x = Math.ceil(west / step) * step; x <= east; x += step) points.push(x, this.ground, -south, x, this.ground, -north);
    for (let y = Math.ceil(south / step) * step; y <= north; y += step) points.push(west, this.ground, -y, east, this.ground, -y);
    if (!this.isDrawn) group.add(segments(points, ink.line, 1));
    for (const wall of store.walls) {
      const isFence = store.isFence(wall);
      if (isFence ? !this.map.layers.fences || wall.name === "fence ceiling" : !this.map.layers.obstacles) continue;
      const base = Math.max(wall.base_m, this.ground);
      const top = Math.min(wall.top_m, store.world.bounds_m[5] ?? wall.top_m);
      if (!(top > base)) continue;
      const shape = new Shape();
      for (const [index, point] of wall.polygon_enu_m.entries()) {
        if (index) shape.lineTo(point[0], point[1]);
        else shape.moveTo(point[0], point[1]);
      }
      const solid = new ExtrudeGeometry(shape, { depth: top - base, bevelEnabled: false });
      solid.rotateX(-Math.PI / 2);
      const colour = isFence ? ink.fence : ink.obstacle;
      const body = new Mesh(solid, new MeshLambertMaterial({ color: colour, transparent: isFence, opacity: isFence ? 0.12 : 1, depthWrite: !isFence }));
      body.position.y = base;
      group.add(body);
      const rim = new LineSegments(new EdgesGeometry(solid, 30), new LineBasicMaterial({ color: isFence ? ink.fence : ink.ground }));
      rim.position.y = base;
      group.add(rim);
    }
    for (const goal of store.allGoals) {
      const ball = new Mesh(new SphereGeometry(Math.max(goal[3], size / 120), 24, 16), new MeshLambertMaterial({ color: ink.goal, transparent: true, opacity: 0.75 }));
      ball.position.copy(at(goal));
      group.add(ball);
      this.line(group, [goal, [goal[0], goal[1], this.groundAt(goal)]], ink.goal);
    }
  }

  // Whether the ground is drawn, by heights or tiles.
  get isDrawn() {
    const { ground, layers } = this.map;
    return Boolean((ground.heights && layers.relief) || (ground.tiles && layers.tiles));
  }

  makeGround(group) {
    const { ground, layers } = this.map;
    if (!this.isDrawn) return;
    const bounds = this.store.world.bounds_m;
    const more = AROUND * Math.max(bounds[1] - bounds[0], bounds[3] - bounds[2]);
    const [west, east, south, north] = [bounds[0] - more, bounds[1] + more, bounds[2] - more, bounds[3] + more];
    const texture = new CanvasTexture(ground.picture([west, east, south, north], this.ink, layers, PICTURE));
    texture.colorSpace = SRGBColorSpace;
    texture.anisotropy = 4;
    const columns = Math.min(GRID, ground.heights?.columns ?? 2);
    const rows = Math.min(GRID, ground.heights?.rows ?? 2);
    const places = [];
    const corners = [];
    const faces = [];
    for (let j = 0; j < rows; j++) {
      for (let i = 0; i < columns; i++) {
        const [u, v] = [i / (columns - 1), j / (rows - 1)];
        const [x, y] = [west + u * (east - west), south + v * (north - south)];
        places.push(x, this.groundAt([x, y]) - 1, -y);
        corners.push(u, v);
        if (i + 1 < columns && j + 1 < rows) {
          const at = j * columns + i;
          faces.push(at, at + 1, at + columns, at + 1, at + columns + 1, at + columns);
        }
      }
    }
    const surface = new BufferGeometry();
    surface.setAttribute("position", new Float32BufferAttribute(places, 3));
    surface.setAttribute("uv", new Float32BufferAttribute(corners, 2));
    surface.setIndex(faces);
    group.add(new Mesh(surface, new MeshBasicMaterial({ map: texture, side: DoubleSide })));
  }

  makeRadars(group) {
    for (const radar of this.store.world.radars ?? []) {
      const isKnown = this.store.isKnown(radar);
      const dome = new Mesh(
        new SphereGeometry(radar.max_threat_radius_m, 32, 12, 0, 2 * Math.PI, 0, Math.PI / 2),
        new MeshBasicMaterial({ color: this.ink.radar, transparent: true, opacity: isKnown ? 0.05 : 0.02, side: DoubleSide, depthWrite: false }),
      );
      dome.position.copy(at(radar.position_enu_m));
      group.add(dome);
      const ring = [];
      for (let k = 0; k <= 64; k++) {
        const angle = (2 * Math.PI * k) / 64;
        ring.push([radar.position_enu_m[0] + radar.max_threat_radius_m * Math.cos(angle), radar.position_enu_m[1] + radar.max_threat_radius_m * Math.sin(angle), this.ground + 3]);
      }
      this.line(group, ring, this.ink.radar, { dashed: true, opacity: isKnown ? 1 : 0.4 });
      const size = radar.max_threat_radius_m / 18;
      const mast = new Mesh(new ConeGeometry(size, 2 * size, 4), new MeshLambertMaterial({ color: this.ink.radar }));
      mast.position.copy(at(radar.position_enu_m, size));
      group.add(mast);
    }
  }

  makeField(group) {
    const field = this.field;
    if (!field) return;
    const width = field.columns * field.spacing_m;
    const height = field.rows * field.spacing_m;
    const texture = new CanvasTexture(fieldPicture(field, this.ink.radar));
    texture.colorSpace = SRGBColorSpace;
    const plane = new Mesh(new PlaneGeometry(width, height), new MeshBasicMaterial({ map: texture, transparent: true, opacity: 0.7, side: DoubleSide, depthWrite: false }));
    plane.rotation.x = -Math.PI / 2;
    plane.position.set(field.west_m - field.spacing_m / 2 + width / 2, field.height_m, -(field.south_m - field.spacing_m / 2 + height / 2));
    group.add(plane);
  }

  makeTrees(group) {
    const { trees } = this.store;
    if (!trees) return;
    const { tree, threatTree } = this.map.layers;
    if (tree) group.add(segments(pairs(trees.tree_enu_m, trees.tree_parents, 0), this.ink.tree, 0.6));
    if (threatTree) group.add(segments(pairs(trees.threat_tree_enu_m, trees.threat_tree_parents, this.ground + 4), this.ink["threat-tree"], 0.6));
  }

  makeWays(group) {
    const { store, ink } = this;
    const { mission, candidate } = this.map.layers;
    if (mission && store.mission) this.way(group, store.mission.waypoints_enu_m, ink.mission, { opacity: 0.6 });
    if (mission && store.plan && store.isFlown) {
      this.line(group, store.plan.path.map((row) => row.slice(1, 4)), ink.mission, { opacity: 0.45 });
    }
    if (candidate && store.candidateOnly) {
      this.way(group, store.candidateOnly.path.map((row) => row.slice(1, 4)), ink.candidate, { dashed: true });
    }
    if (this.map.layers.operator) this.line(group, store.standing?.operator_enu_m ?? [], ink.operator, { dashed: true });
    const home = store.standing?.returns;
    if (this.map.layers.returns && home?.way_enu_m?.length) {
      this.line(group, home.way_enu_m, home.is_safe ? ink.back : ink.goal, { dashed: true });
    }
    const back = store.standing?.handback;
    if (back?.way_enu_m?.length) this.way(group, back.way_enu_m, back.is_safe ? ink.back : ink.goal, { dashed: true });
  }

  makeSubGoals(group) {
    const { store, ink } = this;
    const size = (store.world.bounds_m[1] - store.world.bounds_m[0]) / 160;
    for (const place of store.trees?.sub_goals_enu_m ?? []) {
      const ball = new Mesh(new SphereGeometry(size, 4, 2), new MeshLambertMaterial({ color: ink["sub-goal"] }));
      ball.position.copy(at(place));
      group.add(ball);
    }
  }

  // How far it senses: a circle at its height.
  makeHorizon(group) {
    const { store, ink } = this;
    const [east, north, up] = store.ownship.position_enu_m;
    const ring = [];
    for (let k = 0; k <= 96; k++) {
      const angle = (2 * Math.PI * k) / 96;
      ring.push([east + store.world.sensing_horizon_m * Math.cos(angle), north + store.world.sensing_horizon_m * Math.sin(angle), up]);
    }
    this.line(group, ring, ink.horizon, { dashed: true, opacity: 0.7 });
  }

  makeMoving(group) {
    const { store, ink } = this;
    const layers = this.map.layers;
    const size = (store.world.bounds_m[1] - store.world.bounds_m[0]) / 90;
    if (layers.flown) {
      const rows = store.rows.filter((row) => row[0] <= store.now);
      const step = Math.max(1, Math.floor(rows.length / 1000));
      this.way(group, rows.filter((_, index) => index % step === 0).map((row) => row.slice(1, 4)), ink.flown);
    }
    if (layers.ahead) {
      let drawn = -Infinity;
      for (const entry of store.ahead(30)) {
        if (!entry.covariance || entry.in_s - drawn < 4) continue;
        drawn = entry.in_s;
        const [ee, , nn, uu] = entry.covariance;
        const ball = new Mesh(new SphereGeometry(1, 16, 12), new MeshBasicMaterial({ color: ink.ahead, transparent: true, opacity: 0.28, depthWrite: false }));
        ball.scale.set(2 * Math.sqrt(ee), 2 * Math.sqrt(uu), 2 * Math.sqrt(nn)).clampScalar(size / 8, 1e5);
        ball.position.copy(at(entry.place));
        group.add(ball);
      }
    }
    if (store.ownship) {
      // Seen through walls: where it is matters more than what is before it.
      const look = new MeshLambertMaterial({ color: ink.flown, depthTest: false, transparent: true });
      const craft = new Mesh(new ConeGeometry(0.4, 1.4, 3), look);
      craft.scale.setScalar(0.035 * this.camera.position.distanceTo(at(store.ownship.position_enu_m)));
      craft.renderOrder = 6;
      craft.rotation.order = "YXZ";
      craft.rotation.set(-Math.PI / 2 + store.ownship.flight_path_angle_rad, -store.ownship.course_rad, 0);
      craft.position.copy(at(store.ownship.position_enu_m));
      group.add(craft);
      this.line(group, [store.ownship.position_enu_m, [...store.ownship.position_enu_m.slice(0, 2), this.groundAt(store.ownship.position_enu_m)]], ink.flown, { opacity: 0.6, isOnTop: true });
    }
    if (store.ownship && layers.horizon) this.makeHorizon(group);
    for (const track of layers.tracks ? store.tracks : []) this.makeTrack(group, track, size);
    if (layers.reach) {
      for (const line of this.map.reach.lines) {
        const points = [];
        for (let k = 0; k < (line.pieces?.length ?? 0); k += 2) points.push(line.pieces[k], this.ground + 5, -line.pieces[k + 1]);
        if (points.length) group.add(segments(points, ink.reach, { 10: 1, 20: 0.75, 30: 0.55, 60: 0.35 }[line.seconds] ?? 0.5));
      }
    }
  }

  // Where it may be: the ellipse of two deviations.
  makeSpread(group, track, place, colour) {
    const [ee, en, nn] = [track.covariance[0][0], track.covariance[0][2], track.covariance[2][2]];
    const middle = (ee + nn) / 2;
    const apart = Math.hypot((ee - nn) / 2, en);
    const disc = new Mesh(new SphereGeometry(1, 32, 4), new MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.35, depthWrite: false }));
    disc.scale.set(2 * Math.sqrt(Math.max(0, middle + apart)), 1, 2 * Math.sqrt(Math.max(0, middle - apart)));
    disc.rotation.y = 0.5 * Math.atan2(2 * en, ee - nn);
    disc.position.copy(at(place, 2));
    group.add(disc);
  }

  makeTrack(group, track, size) {
    const colour = track.flies_on ? this.ink.muted : this.ink.dynamic;
    const height = track.is_airborne ? track.position_enu_m[2] : Math.max(this.ground, track.position_enu_m[2]);
    const place = [track.position_enu_m[0], track.position_enu_m[1], height];
    const body = new Mesh(new SphereGeometry(size / 2, 16, 12), new MeshLambertMaterial({ color: colour }));
    body.position.copy(at(place, size / 3));
    group.add(body);
    const [ve, vn] = track.velocity_enu_m_s;
    const ahead = track.flies_on ? 30 : 10;
    this.line(group, [place, [place[0] + ve * ahead, place[1] + vn * ahead, height]], colour, { width: 2 });
    this.makeSpread(group, track, place, colour);
    if (track.flies_on) return;
    const dome = new Mesh(
      new SphereGeometry(track.max_threat_radius_m, 32, 12, 0, 2 * Math.PI, 0, Math.PI / 2),
      new MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.14, side: DoubleSide, depthWrite: false }),
    );
    dome.position.copy(at(place));
    group.add(dome);
  }
}

function pairs(places, parents, level) {
  const points = [];
  for (let row = 0; row < places.length; row++) {
    const parent = parents[row];
    if (parent < 0 || parent >= places.length) continue;
    for (const place of [places[parent], places[row]]) points.push(place[0], place[2] ?? level, -place[1]);
  }
  return points;
}

function segments(points, colour, opacity) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(points, 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color: new Color(colour), transparent: opacity < 1, opacity, depthWrite: opacity === 1 }));
}

"use strict";
/* Sorting, choosing, hints; and replays of episodes. Replays are unpacked when they are opened; sumo_mcts/reporting/replay.py packs them. */

const $ = (id) => document.getElementById(id);
const all = (selector, within = document) => [...within.querySelectorAll(selector)];

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== null) made.setAttribute(name, value);
  made.append(...children.filter((child) => child !== null));
  return made;
}

const signed = (value, digits) => (value < 0 ? "\u2212" : "+") + Math.abs(value).toFixed(digits);

/* --- the page --- */

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

$("theme").addEventListener("click", () => {
  const theme = isDark() ? "light" : "dark";
  document.documentElement.dataset.theme = theme;
  try { localStorage.setItem("sumo-mcts-theme", theme); } catch { /* private mode */ }
  if (player) player.restyle();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => player && player.restyle());

/** Rows in the order of a column; again: the reverse order. Unknown values come last. */
function sort(header) {
  const table = header.closest("table"), body = table.tBodies[0], column = header.cellIndex;
  const down = header.getAttribute("aria-sort") === "ascending";
  const value = (row) => {
    const told = row.cells[column].dataset.v;
    return told === undefined ? row.cells[column].textContent.trim() : told === "" ? null : Number(told);
  };
  const compare = (a, b) => (typeof a === "number" && typeof b === "number" ? (a === b ? 0 : a - b) : String(a).localeCompare(String(b), "en", { numeric: true }));
  const rows = [...body.rows].map((row) => [value(row), row]);
  rows.sort(([a], [b]) => (a === null ? 1 : 0) - (b === null ? 1 : 0) || (down ? compare(b, a) : compare(a, b)));
  body.append(...rows.map(([, row]) => row));
  for (const other of all("th", table)) other.removeAttribute("aria-sort");
  header.setAttribute("aria-sort", down ? "descending" : "ascending");
  if (table.classList.contains("grouped")) group(table);
}

/** A name that stands in the row above already is not shown again. */
function group(table) {
  let above = null;
  for (const row of table.tBodies[0].rows) {
    if (row.hidden) continue;
    const name = row.cells[0].textContent;
    row.cells[0].classList.toggle("same", name === above);
    row.classList.toggle("first", name !== above);
    above = name;
  }
}

for (const table of all("table.sortable")) {
  for (const header of all("th", table)) header.firstChild.addEventListener("click", () => sort(header));
  if (table.classList.contains("grouped")) group(table);
}

/** A select that shows those elements whose `data-` attribute is its value. */
function chooser(select, apply) {
  if (!select) return;
  select.addEventListener("change", () => apply(select.value));
  apply(select.value);
}

chooser($("focus"), (variant) => {
  for (const tiles of all(".tiles")) tiles.hidden = tiles.dataset.variant !== variant;
  for (const row of all("tr[data-variant]:not([data-against])")) row.classList.toggle("focus", row.dataset.variant === variant);
});
chooser($("scene"), (scene) => {
  for (const figures of all(".figures")) figures.hidden = figures.dataset.scene !== scene;
});
chooser($("with"), (variant) => {
  for (const row of all("tr[data-against]")) row.hidden = variant !== "" && row.dataset.variant !== variant && row.dataset.against !== variant;
  group($("table-variants"));
});

/* Hints for pointer and keyboard. */
function hint(target) {
  const box = target.getBoundingClientRect(), tip = $("tip");
  tip.textContent = target.dataset.tip;
  (target.closest("dialog") || document.body).append(tip);
  tip.hidden = false;
  const { width, height } = tip.getBoundingClientRect();
  const left = Math.min(Math.max(8, box.left + box.width / 2 - width / 2), innerWidth - width - 8);
  const below = box.bottom + 8 + height < innerHeight;
  tip.style.left = `${left}px`;
  tip.style.top = `${below ? box.bottom + 8 : Math.max(8, box.top - height - 8)}px`;
}
for (const event of ["pointerover", "focusin"]) {
  document.addEventListener(event, (e) => {
    const target = e.target.closest && e.target.closest("[data-tip]");
    if (target && (event === "pointerover" || (target.matches(":focus-visible") && !target.closest("dialog")))) hint(target);
    else $("tip").hidden = true;
  });
}
document.addEventListener("focusout", () => { $("tip").hidden = true; });

/* --- unpacking: the mirror of replay.py --- */

async function unpack(key) {
  const packed = all("script.replay").find((script) => script.dataset.key === key);
  if (!packed) throw new Error("this page holds no replay of that episode");
  if (typeof DecompressionStream === "undefined") throw new Error("this browser cannot unpack replays (it has no DecompressionStream)");
  const bytes = Uint8Array.from(atob(packed.textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return prepared(await new Response(stream).json());
}

/** Values from their differences. */
function sums(differences, unit) {
  let sum = 0;
  return differences.map((d) => (sum += d) / unit);
}

/** The points [[x, y], ...] of a path, from its first point, first step and changes of step. */
function polyline(bends, unit) {
  const points = [];
  let x = 0, y = 0, dx = 0, dy = 0;
  for (let i = 0; i < bends.length; i += 2) {
    if (i < 4) [dx, dy] = [bends[i], bends[i + 1]];
    else { dx += bends[i]; dy += bends[i + 1]; }
    x += dx; y += dy;
    points.push([x / unit, y / unit]);
  }
  return points;
}

function track(packed) {
  return { x: sums(packed.x, 100), y: sums(packed.y, 100), h: sums(packed.h, 1000), v: sums(packed.v, 100), length: packed.size[0] / 100, width: packed.size[1] / 100 };
}

function prepared(data) {
  const cost = (value) => (value === null ? null : value / 1000);
  return {
    outcome: data.outcome,
    time: sums(data.time, 1000),
    lanes: data.lanes.filter((lane) => !lane.s).map((lane) => ({ ...lane, p: polyline(lane.p, 100), w: lane.w / 100 })),
    stops: data.lanes.filter((lane) => lane.s).map((lane) => polyline(lane.p, 100)),
    ego: { ...track(data.ego), a: sums(data.ego.a, 100) },
    others: data.others.map((other) => ({ ...other, ...track(other) })),
    terms: data.terms,
    cycles: data.cycles.map((cycle) => ({
      ...cycle,
      plan: polyline(cycle.plan, 100),
      tried: cycle.tried.map(([accel, change, visits, mean, best, terms, bends]) => ({ accel: accel / 100, change, visits, mean: cost(mean), best: cost(best), terms: terms.map(cost), path: polyline(bends, 10) })),
      forecast: cycle.forecast.map(([share, bends]) => ({ share: share / 100, path: polyline(bends, 10) })),
    })),
  };
}

/* --- the road from above --- */

const BRAKING = 1, LEFT = 2, RIGHT = 4;
const PIXELS = 9.5; // a metre, at least, without zoom: the whole path is shown where it fits, else a window follows the ego
const SMALLEST_VIEW = 60; // m

class Road {
  constructor(canvas, data) {
    this.canvas = canvas;
    this.data = data;
    this.zoom = 1;
    this.paths = data.lanes.map((lane) => this.path(lane.p));
    this.borders = data.lanes.map((lane) => (lane.b ? this.path(beside(lane.p, lane.w / 2)) : null));
    this.hulls = this.junctions();
    this.restyle();
  }

  restyle() {
    const probe = element("i");
    document.body.append(probe);
    this.colour = {};
    for (const name of ["land", "kerb", "asphalt", "route", "paint", "agent", "agent-dark", "ego", "ego-dark", "brake", "blink", "sheet", "ink", "muted", "rule", "alarm"]) {
      probe.style.color = `var(--${name})`;
      this.colour[name] = getComputedStyle(probe).color;
    }
    probe.remove();
  }

  path(points) {
    const path = new Path2D();
    points.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
    return path;
  }

  /** A smooth line through points (Catmull and Rom's). */
  curve(points) {
    const path = new Path2D();
    points.forEach((b, i) => {
      if (!i) { path.moveTo(...b); return; }
      const a = points[i - 1], before = points[i - 2] || a, after = points[i + 1] || b;
      path.bezierCurveTo(a[0] + (b[0] - before[0]) / 6, a[1] + (b[1] - before[1]) / 6, b[0] - (after[0] - a[0]) / 6, b[1] - (after[1] - a[1]) / 6, ...b);
    });
    return path;
  }

  /** The area of each junction: the hull of the lanes inside it. */
  junctions() {
    const inside = new Map();
    for (const lane of this.data.lanes.filter((l) => l.i)) {
      const sides = [...beside(lane.p, lane.w / 2), ...beside(lane.p, -lane.w / 2)];
      inside.set(lane.j, [...(inside.get(lane.j) || []), ...sides]);
    }
    return [...inside.values()].map((points) => { const path = this.path(hull(points)); path.closePath(); return path; });
  }

  /** Metres to pixels around this place. */
  view(x, y) {
    const { width, height } = this.canvas, { ego } = this.data;
    const [west, east] = [Math.min(...ego.x), Math.max(...ego.x)], [south, north] = [Math.min(...ego.y), Math.max(...ego.y)];
    const needed = Math.max(east - west + 40, ((north - south + 40) * width) / height, SMALLEST_VIEW);
    const most = width / devicePixelRatio / PIXELS, whole = needed <= 1.2 * most && this.zoom === 1;
    this.scale = (width / (whole ? needed : Math.min(needed, most))) * this.zoom;
    this.middle = whole ? [(west + east) / 2, (south + north) / 2] : [x, y];
  }

  place(x, y) {
    return [this.canvas.width / 2 + (x - this.middle[0]) * this.scale, this.canvas.height / 2 - (y - this.middle[1]) * this.scale];
  }

  /** Everything at this moment; `marked`: the tried action to point out, -1 none. */
  draw(moment, marked) {
    const { canvas, colour } = this, c = canvas.getContext("2d");
    this.view(moment.ego.x, moment.ego.y);
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = colour.land;
    c.fillRect(0, 0, canvas.width, canvas.height);
    const [x0, y0] = this.place(0, 0);
    c.setTransform(this.scale, 0, 0, -this.scale, x0, y0);
    c.lineCap = "butt";
    c.lineJoin = "round";
    this.ground(c);
    this.forecast(c, moment);
    this.tried(c, moment.cycle, marked);
    this.plan(c, moment);
    for (const other of moment.others) this.vehicle(c, other, colour.agent, colour["agent-dark"]);
    this.vehicle(c, moment.ego, colour.ego, colour["ego-dark"], true);
  }

  ground(c) {
    const { colour, data } = this;
    for (const [extra, paint] of [[0.7, colour.kerb], [0.1, colour.asphalt]]) {
      c.fillStyle = c.strokeStyle = paint;
      c.lineWidth = extra;
      for (const area of this.hulls) { c.fill(area); c.stroke(area); }
      data.lanes.forEach((lane, i) => { c.lineWidth = lane.w + extra; c.stroke(this.paths[i]); });
    }
    c.strokeStyle = colour.route;
    data.lanes.forEach((lane, i) => { if (lane.r) { c.lineWidth = lane.w; c.stroke(this.paths[i]); } });
    c.strokeStyle = colour.paint;
    c.lineWidth = 0.18;
    data.lanes.forEach((lane, i) => { if (lane.b) { c.setLineDash(lane.b === 1 ? [3, 4.5] : []); c.stroke(this.borders[i]); } });
    c.setLineDash([]);
    c.lineWidth = 0.45;
    for (const line of data.stops) c.stroke(this.path(line));
  }

  /** Where the others are expected, every second, fading. */
  forecast(c, { cycle }) {
    c.fillStyle = c.strokeStyle = this.colour.agent;
    c.lineWidth = 0.25;
    for (const { share, path: points } of cycle.forecast) {
      c.globalAlpha = 0.12 + 0.28 * share;
      c.stroke(this.curve(points));
      points.slice(1).forEach(([x, y], k) => {
        c.globalAlpha = (0.3 + 0.6 * share) * (1 - 0.13 * k);
        dot(c, x, y, 0.6);
      });
    }
    c.globalAlpha = 1;
  }

  /** The best continuation of each action at the root, the more visited the stronger, with its end marked. */
  tried(c, cycle, marked) {
    const most = Math.max(1, ...cycle.tried.map((child) => child.visits));
    cycle.tried.forEach((child, i) => {
      if (!child.path.length || (i === cycle.chosen && i !== marked)) return;
      c.strokeStyle = c.fillStyle = this.colour.ego;
      c.globalAlpha = i === marked ? 1 : 0.2 + 0.4 * Math.sqrt(child.visits / most);
      c.lineWidth = i === marked ? 0.6 : 0.22;
      c.stroke(this.curve(child.path));
      const [x, y] = child.path[child.path.length - 1];
      dot(c, x, y, i === marked ? 0.8 : 0.4);
    });
    c.globalAlpha = 1;
  }

  plan(c, { cycle, ego, elapsed }) {
    const ahead = cycle.plan.filter((_, k) => (k + 1) / 2 > elapsed + 0.05);
    if (!ahead.length) return;
    c.strokeStyle = this.colour.ego;
    c.lineWidth = 0.55;
    c.stroke(this.curve([[ego.x, ego.y], ...ahead]));
    cycle.plan.forEach(([x, y], k) => {
      if (k % 2 === 0 || (k + 1) / 2 <= elapsed || Math.hypot(x - ego.x, y - ego.y) < 1.5) return;
      c.fillStyle = this.colour.ego;
      dot(c, x, y, 0.68);
      c.fillStyle = this.colour.sheet;
      dot(c, x, y, 0.36);
    });
  }

  /** A vehicle from above: a slightly narrower nose, a windscreen, brake lights, turn signals. */
  vehicle(c, car, body, glass, halo = false) {
    if (car.person) { c.fillStyle = glass; dot(c, car.x, car.y, 0.45); return; }
    const half = car.length / 2, side = car.width / 2, corner = Math.min(0.5, 0.25 * car.length), lamp = Math.min(0.45, 0.12 * car.length);
    c.save();
    c.translate(car.x, car.y);
    c.rotate(car.h);
    const outline = [[half, 0.55 * side], [half - corner, side], [-half + 0.4 * corner, side], [-half, 0.75 * side]];
    const shape = this.path([...outline, ...outline.map(([x, y]) => [x, -y]).reverse()]);
    shape.closePath();
    if (halo) { c.strokeStyle = this.colour.sheet; c.lineWidth = 0.9; c.stroke(shape); }
    c.fillStyle = body;
    c.fill(shape);
    const front = half - Math.min(1.1, 0.25 * car.length), back = front - Math.min(0.75, 0.2 * car.length);
    c.fillStyle = glass;
    c.fill(this.path([[front, 0.74 * side], [front, -0.74 * side], [back, -0.62 * side], [back, 0.62 * side]]));
    c.fillStyle = this.colour.brake;
    if (car.lamps & BRAKING) for (const sign of [1, -1]) c.fillRect(-half - 0.1, sign > 0 ? 0.35 * side : -side, lamp + 0.1, 0.65 * side);
    c.fillStyle = this.colour.blink;
    const signal = car.lamps & LEFT ? 1 : car.lamps & RIGHT ? -1 : 0;
    if (signal) for (const along of [half - corner, -half + lamp]) dot(c, along, signal * side, 0.34);
    c.restore();
  }
}

function dot(c, x, y, radius) {
  c.beginPath();
  c.arc(x, y, radius, 0, 2 * Math.PI);
  c.fill();
}

/** The line at this distance to the left of another. */
function beside(points, distance) {
  return points.map(([x, y], i) => {
    const [ax, ay] = points[Math.max(i - 1, 0)], [bx, by] = points[Math.min(i + 1, points.length - 1)];
    const length = Math.hypot(bx - ax, by - ay) || 1;
    return [x - ((by - ay) / length) * distance, y + ((bx - ax) / length) * distance];
  });
}

/** The convex hull (Andrew's monotone chain). */
function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (ordered) => {
    const chain = [];
    for (const p of ordered) {
      for (let a, b; chain.length > 1 && ([a, b] = chain.slice(-2)) && (b[0] - a[0]) * (p[1] - a[1]) <= (b[1] - a[1]) * (p[0] - a[0]); ) chain.pop();
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/* --- playing --- */

const RATES = [0.1, 0.25, 0.5, 1, 2, 4, 8];
let player = null;

class Player {
  constructor(key, why, data, start) {
    Object.assign(this, { key, data, rate: 1, playing: false, marked: -1, shown: -1 });
    this.begin = data.time[0];
    this.end = data.time[data.time.length - 1];
    this.time = Math.min(Math.max(start ?? this.begin, this.begin), this.end);
    this.road = new Road($("road"), data);
    $("replay-title").textContent = key;
    $("replay-why").textContent = why;
    Object.assign($("scrub"), { min: this.begin, max: this.end, value: this.time });
    this.events = data.cycles.map((cycle, k) => ((cycle.failsafe && !(k && data.cycles[k - 1].failsafe)) || cycle.off || cycle.detour ? k : -1)).filter((k) => k >= 0);
    $("event").disabled = !this.events.length;
    this.resize();
  }

  resize() {
    for (const id of ["road", "speeds"]) {
      const canvas = $(id), box = canvas.getBoundingClientRect();
      canvas.width = Math.max(1, Math.round(box.width * devicePixelRatio));
      canvas.height = Math.max(1, Math.round(box.height * devicePixelRatio));
    }
    this.speeds();
    this.show();
  }

  restyle() {
    this.road.restyle();
    this.speeds();
    this.show();
  }

  /** The last decision before this moment. */
  get cycle() {
    const { time } = this.data;
    let k = time.findIndex((t) => t > this.time + 1e-6);
    return (k < 0 ? time.length : Math.max(k, 1)) - 1;
  }

  get moment() {
    const { data } = this, k = this.cycle, next = Math.min(k + 1, data.time.length - 1);
    const elapsed = this.time - data.time[k], share = next > k ? elapsed / (data.time[next] - data.time[k]) : 0;
    const between = (car, a, b) => {
      const part = (column) => column[a] + (column[b] - column[a]) * share;
      return { x: part(car.x), y: part(car.y), h: part(car.h), v: part(car.v), length: car.length, width: car.width };
    };
    const others = data.others.filter((other) => k >= other.from && k < other.from + other.x.length).map((other) => {
      const a = k - other.from;
      return { ...between(other, a, Math.min(a + 1, other.x.length - 1)), id: other.id, person: other.person, lamps: other.lamps[a] };
    });
    return { cycle: data.cycles[k], elapsed, others, ego: { ...between(data.ego, k, next), lamps: data.ego.a[k] < -1 ? BRAKING : 0 } };
  }

  show() {
    const k = this.cycle;
    this.road.draw(this.moment, this.marked);
    const clock = `${this.time.toFixed(1)} s`;
    $("clock").textContent = `${clock} of ${this.end.toFixed(1)}`;
    $("scrub").value = this.time;
    $("scrub").setAttribute("aria-valuetext", `${clock}: ${this.data.cycles[k].does}`);
    if (k !== this.shown) this.decision(k);
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.begin), this.end);
    this.show();
  }

  step(by) {
    this.pause();
    const k = this.cycle, { time } = this.data;
    this.seek(by < 0 && this.time > time[k] + 1e-6 ? time[k] : time[Math.min(Math.max(k + by, 0), time.length - 1)]);
  }

  nextEvent() {
    if (!this.events.length) return;
    this.pause();
    this.seek(this.data.time[this.events.find((k) => this.data.time[k] > this.time + 1e-6) ?? this.events[0]]);
  }

  play() {
    if (this.time >= this.end - 1e-6) this.time = this.begin;
    this.playing = true;
    this.button();
    let last = null;
    const tick = (now) => {
      if (!this.playing || player !== this) return;
      if (last !== null) this.seek(this.time + ((now - last) / 1000) * this.rate);
      last = now;
      if (this.time < this.end - 1e-6) return void requestAnimationFrame(tick);
      this.seek(this.end); // it may be a hair before it
      this.pause();
    };
    requestAnimationFrame(tick);
  }

  pause() {
    this.playing = false;
    this.button();
    history.replaceState(null, "", `#replay=${encodeURIComponent(this.key)}&t=${this.time.toFixed(1)}`);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  button() {
    $("play").textContent = this.playing ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
  }

  faster(by) {
    this.rate = RATES[Math.min(Math.max(RATES.indexOf(this.rate) + by, 0), RATES.length - 1)];
    $("rate").textContent = `${this.rate}×`;
  }

  zoom(by) {
    this.road.zoom = Math.min(Math.max(this.road.zoom * by, 0.2), 8);
    this.show();
  }

  /** Speed over time, with the events. */
  speeds() {
    const canvas = $("speeds"), c = canvas.getContext("2d"), { data } = this, { colour } = this.road, ratio = devicePixelRatio;
    const top = Math.max(1, ...data.ego.v), foot = canvas.height - 14 * ratio;
    const x = (time) => ((time - this.begin) / Math.max(this.end - this.begin, 1e-9)) * canvas.width;
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.beginPath();
    c.moveTo(0, foot);
    data.time.forEach((time, k) => c.lineTo(x(time), foot - (data.ego.v[k] / top) * (foot - 4 * ratio)));
    c.lineTo(canvas.width, foot);
    c.fillStyle = colour.ego;
    c.globalAlpha = 0.16;
    c.fill();
    c.globalAlpha = 1;
    data.cycles.forEach((cycle, k) => {
      if (!cycle.failsafe && !cycle.off && !cycle.detour) return;
      c.fillStyle = cycle.failsafe ? colour.alarm : colour.muted;
      c.fillRect(x(data.time[k]), cycle.failsafe ? 0 : foot - 8 * ratio, 2 * ratio, cycle.failsafe ? foot : 8 * ratio);
    });
  }

  /* what was decided, and what else was tried */

  decision(k) {
    this.shown = k;
    this.marked = -1;
    const cycle = this.data.cycles[k], { ego } = this.data, last = k === this.data.cycles.length - 1;
    $("does").textContent = cycle.does;
    $("why").textContent = cycle.failsafe ? "" : cycle.released ? "SUMO's own driver: nothing was searched" : `decided by: ${cycle.why || "?"}`;
    $("failsafe").hidden = !cycle.failsafe;
    $("failsafe").textContent = cycle.failsafe ? cycle.why : "";
    const facts = [["decision", `${k + 1} of ${this.data.cycles.length}`], ["speed", `${ego.v[k].toFixed(1)} m/s`], ["acceleration", `${signed(ego.a[k], 1)} m/s²`],
      ["planning", cycle.ms === null ? "-" : `${cycle.ms.toFixed(1)} ms`, "Wall time from the scene to the decision."],
      ["iterations", String(cycle.n), "Passes of the search that simulated to its horizon."],
      ["known ends", String(cycle.known), "Further passes, which cost next to nothing: they reached the end of a sequence that had been simulated before."]];
    if (last) facts.push(["outcome", this.data.outcome.replaceAll("_", " ")]);
    if (cycle.detour) facts.push(["lane missed", cycle.detour, "The lane does not lead on along the route; what the ego did about it right before this decision."]);
    if (cycle.off) facts.push(["executed", cycle.off, "What came of the command, where it is not what was commanded."]);
    $("facts").replaceChildren(...facts.map(([name, value, tip]) => element("div", { "data-tip": tip ?? null }, element("dt", {}, name), element("dd", {}, value))));
    $("actions").replaceChildren(...(cycle.tried.length ? this.table(cycle) : [element("p", { class: "muted" }, "No action was tried at this decision.")]));
  }

  table(cycle) {
    const most = Math.max(1, ...cycle.tried.map((child) => child.visits));
    const weight = (child) => child.terms.reduce((sum, term) => sum + Math.abs(term ?? 0), 0);
    const largest = Math.max(1e-9, ...cycle.tried.map(weight));
    const order = cycle.tried.map((_, i) => i).sort((a, b) => (cycle.tried[a].best ?? Infinity) - (cycle.tried[b].best ?? Infinity) || a - b);
    const head = [["action", "What was tried first, m/s²."], ["lane", "To which side the lane is changed, where it is."], ["visits", "How often the search went there."], ["mean", "Mean cost of all passes."], ["best", "Cost of the best sequence found. Planner mcts takes the lowest, paper the lowest mean."], ["made of", "The terms of the best sequence's cost, in the likeliest hypothesis."]];
    const rows = order.map((i) => {
      const child = cycle.tried[i];
      const row = element("tr", { class: [i === cycle.chosen ? "chosen" : "", child.best === null || child.terms[4] > 0 ? "lost" : ""].join(" ").trim(), tabindex: "0" },
        element("td", {}, named(child)), element("td", {}, child.change > 0 ? "← left" : child.change < 0 ? "→ right" : ""),
        element("td", { class: "n visits" }, element("i", { style: `--w: ${(100 * child.visits) / most}%` }), element("span", {}, String(child.visits))),
        element("td", { class: "n" }, costs(child.mean)), element("td", { class: "n" }, costs(child.best)),
        element("td", {}, this.terms(child, largest)));
      for (const [event, marked] of [["pointerenter", i], ["focus", i], ["pointerleave", -1], ["blur", -1]]) {
        row.addEventListener(event, () => { this.marked = marked; this.show(); });
      }
      return row;
    });
    const shown = this.data.terms.filter((_, t) => cycle.tried.some((child) => child.terms[t]));
    return [
      element("table", {}, element("caption", {}, "Actions at the root, cheapest first; point at one to see its path."),
        element("thead", {}, element("tr", {}, ...head.map(([name, tip], i) => element("th", { scope: "col", "data-tip": tip, class: i > 1 && i < 5 ? "n" : null }, name)))),
        element("tbody", {}, ...rows)),
      element("p", { class: "termkey" }, ...shown.map((term) => element("span", {}, element("i", { class: `t-${term}` }), term))),
    ];
  }

  terms(child, largest) {
    const told = this.data.terms.map((term, t) => `${term} ${(child.terms[t] ?? 0).toFixed(2)}`).join(", ");
    const bars = this.data.terms.map((term, t) => element("i", { class: `t-${term}`, style: `width: ${(100 * Math.abs(child.terms[t] ?? 0)) / largest}%` }));
    return element("div", { class: "terms", role: "img", "aria-label": told, "data-tip": told }, ...bars);
  }
}

const costs = (value) => (value === null ? "lost" : value.toFixed(2));

function named(child) {
  return `${signed(child.accel, 1)}${child.visits ? "" : " (last plan)"}`;
}

/* --- opening and closing --- */

async function openReplay(key, start) {
  const row = all("tr[data-key]").find((candidate) => candidate.dataset.key === key);
  $("trouble").hidden = true;
  if (!$("replay").open) $("replay").showModal();
  try {
    player = new Player(key, row ? row.dataset.why : "", await unpack(key), start);
    player.faster(0);
    player.pause();
    $("play").focus();
  } catch (error) {
    player = null;
    $("replay-title").textContent = key;
    $("trouble").textContent = `This replay cannot be shown: ${error.message}.`;
    $("trouble").hidden = false;
  }
}

function closed() {
  if (player) player.playing = false;
  player = null;
  history.replaceState(null, "", location.pathname + location.search);
}

function follow() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const time = Number(asked.get("t") ?? NaN);
  if (asked.get("replay")) openReplay(asked.get("replay"), Number.isFinite(time) ? time : undefined);
}

for (const button of all("button.open")) button.addEventListener("click", () => openReplay(button.closest("tr").dataset.key));
$("close").addEventListener("click", () => $("replay").close());
$("replay").addEventListener("close", closed);
$("play").addEventListener("click", () => player && player.toggle());
$("back").addEventListener("click", () => player && player.step(-1));
$("on").addEventListener("click", () => player && player.step(1));
$("event").addEventListener("click", () => player && player.nextEvent());
$("slower").addEventListener("click", () => player && player.faster(-1));
$("faster").addEventListener("click", () => player && player.faster(1));
$("nearer").addEventListener("click", () => player && player.zoom(1.25));
$("farther").addEventListener("click", () => player && player.zoom(0.8));
$("scrub").addEventListener("input", () => { if (player) { player.pause(); player.seek(Number($("scrub").value)); } });
$("road").addEventListener("wheel", (e) => { e.preventDefault(); if (player) player.zoom(e.deltaY < 0 ? 1.15 : 0.87); }, { passive: false });
$("road").addEventListener("pointermove", (e) => {
  if (!player) return;
  const box = $("road").getBoundingClientRect(), moment = player.moment;
  const near = [{ ...moment.ego, id: "ego" }, ...moment.others].find((car) => {
    const [x, y] = player.road.place(car.x, car.y);
    return Math.hypot(x / devicePixelRatio - (e.clientX - box.left), y / devicePixelRatio - (e.clientY - box.top)) < 14;
  });
  $("who").hidden = !near;
  if (near) {
    $("who").textContent = `${near.id}: ${near.v.toFixed(1)} m/s`;
    $("who").style.left = `${e.clientX - box.left + 14}px`;
    $("who").style.top = `${e.clientY - box.top + 10}px`;
  }
});
new ResizeObserver(() => player && player.resize()).observe($("replay"));
addEventListener("hashchange", follow);

const KEYS = {
  " ": () => player.toggle(), ArrowLeft: () => player.step(-1), ArrowRight: () => player.step(1), Home: () => { player.pause(); player.seek(player.begin); },
  End: () => { player.pause(); player.seek(player.end); }, "+": () => player.faster(1), "=": () => player.faster(1), "-": () => player.faster(-1), n: () => player.nextEvent(),
  "]": () => player.zoom(1.25), "[": () => player.zoom(0.8),
};
document.addEventListener("keydown", (e) => {
  const act = KEYS[e.key];
  if (!player || !act || e.ctrlKey || e.metaKey || e.altKey) return;
  if (e.key === " " && e.target instanceof HTMLButtonElement && e.target.id !== "play") return; // space presses the button that has the focus
  e.preventDefault();
  act();
});

follow();

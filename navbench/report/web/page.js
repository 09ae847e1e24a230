"use strict";
// Tables: sorted by a click or a key on their headings, filtered by words and by a column's values.
const one = (selector, of = document) => of.querySelector(selector);
const all = (selector, of = document) => [...of.querySelectorAll(selector)];
const MANY = 8; // rows, from which on a table has a filter

function keyOf(cell) {
  if (cell.dataset.sort !== undefined) return Number(cell.dataset.sort);
  const text = cell.textContent.trim(), number = parseFloat(text.replace(/^\[/, ""));
  return text === "" || text === "–" ? null : /^[-+[]?\d/.test(text) && !Number.isNaN(number) ? number : text.toLowerCase();
}

function compare(a, b) {
  if (a === null || b === null) return 0;
  if (typeof a === typeof b) return a < b ? -1 : a > b ? 1 : 0;
  return typeof a === "number" ? -1 : 1;
}

function sortBy(table, head, column) {
  const down = head.getAttribute("aria-sort") === "ascending";
  for (const other of all("th[aria-sort]", table)) other.setAttribute("aria-sort", "none");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const body = one("tbody", table), rows = [...body.rows].map(row => [keyOf(row.cells[column]), row]);
  const missing = rows.filter(([key]) => key === null), there = rows.filter(([key]) => key !== null);
  there.sort(([a], [b]) => down ? compare(b, a) : compare(a, b));
  body.append(...[...there, ...missing].map(([, row]) => row)); // what is missing stays last
}

function filter(tabled) {
  const words = one("input", tabled).value.toLowerCase().split(/\s+/).filter(Boolean);
  const heads = all("thead tr:last-child th", tabled).map(head => head.dataset.column);
  const chosen = all(".bar select", tabled).filter(select => select.value)
    .map(select => [heads.indexOf(select.dataset.column), select.value]);
  let shown = 0;
  const rows = [...one("tbody", tabled).rows];
  for (const row of rows) {
    const text = row.textContent.toLowerCase();
    row.hidden = !(words.every(word => text.includes(word)) && chosen.every(([column, value]) => {
      const told = one("summary", row.cells[column]) || row.cells[column];
      return told.textContent.trim().split(":")[0] === value.split(":")[0];
    }));
    shown += !row.hidden;
  }
  one("output", tabled).value = `${shown} of ${rows.length} rows`;
}

for (const tabled of all(".tabled")) {
  const table = one("table", tabled), count = one("tbody", table).rows.length;
  one(".scroll", tabled).classList.toggle("long", count > 30);
  all("thead tr:last-child th", table).forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = head.textContent.trim() || "name";
    head.replaceChildren(button);
    head.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => sortBy(table, head, column));
  });
  if (count > MANY) {
    one(".bar", tabled).hidden = false;
    for (const control of all("input, select", one(".bar", tabled))) control.addEventListener("input", () => filter(tabled));
    filter(tabled);
  }
}

if (matchMedia("(max-width: 45rem)").matches) one("nav details").open = false;

function choose(tabled, column, value) { // show a table's rows of one value
  const select = all(".bar select", tabled).find(one => one.dataset.column === column);
  if (select) select.value = value;
  one(".bar", tabled).hidden = false;
  filter(tabled);
  tabled.scrollIntoView();
  one(".scroll", tabled).focus({ preventScroll: true });
}

for (const button of all(".chips button")) {
  button.addEventListener("click", () => {
    const { verdict, outcome } = button.dataset, column = verdict ? "verdict" : "outcome";
    const tabled = verdict ? all(".tabled").find(tabled => one("table[data-name=claims]", tabled)) : one("#rows")?.closest(".tabled");
    if (tabled) choose(tabled, column, verdict || outcome);
  });
}

addEventListener("beforeprint", () => { for (const details of all("details")) details.open = true; });

// The player.
const QUANTA = [1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3]; // of t, x, y, heading, v, w
const GREY = "#444444"; // of the colours, which is lost on a dark page
const TURN = 2 * Math.PI;
const DATA = one("#data") ? JSON.parse(one("#data").textContent) : { episodes: [] };

async function inflated(text) {
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unpackStates(bytes) { // see navbench/report/packed.py
  const count = bytes.length / 4;
  let place = 0;
  const column = (length, quantum, low) => {
    const values = new Float64Array(length);
    for (let i = 0, sum = 0; i < length; i++, place++) {
      sum = sum + (bytes[place] | bytes[count + place] << 8 | bytes[2 * count + place] << 16 | bytes[3 * count + place] << 24) | 0;
      values[i] = low === undefined ? sum * quantum : sum === 0 ? NaN : low + (sum - 1) * quantum;
    }
    return values;
  };
  for (const episode of DATA.episodes) {
    for (const robot of episode.robots) {
      [robot.t, robot.x, robot.y, robot.heading, robot.v, robot.w] = QUANTA.map(quantum => column(robot.n, quantum));
      robot.trace = Object.fromEntries(robot.traces.map(([name, low, quantum]) => [name, column(robot.n, quantum, low)]));
      robot.ranges = Array.from({ length: robot.sensors || 0 }, () => column(robot.n, 1e-3, 0));
      robot.path = new Path2D();
      for (let i = 0; i < robot.n; i++) robot.path.lineTo(robot.x[i], robot.y[i]);
    }
  }
}

async function unpackLayouts(bytes) {
  const layouts = JSON.parse(new TextDecoder().decode(bytes));
  for (const layout of layouts) {
    if (!layout.grid) continue;
    const [x, y, side, width, height, cells] = layout.grid, bits = await inflated(cells);
    layout.grid = { x, y, side, width, height, at: (i, j) => bits[(j * width + i) >> 3] >> 7 - ((j * width + i) & 7) & 1 };
  }
  return layouts;
}

const lastOf = robot => robot.t[robot.n - 1];

function indexAt(robot, t) { // of the control period that holds t
  let low = 0, high = robot.n - 1;
  while (low < high) {
    const middle = low + high + 1 >> 1;
    if (robot.t[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

function poseAt(robot, t) {
  const i = indexAt(robot, t), j = Math.min(i + 1, robot.n - 1), span = robot.t[j] - robot.t[i];
  const part = span > 0 ? Math.min((t - robot.t[i]) / span, 1) : 0;
  let turn = (robot.heading[j] - robot.heading[i]) % TURN;
  turn -= Math.abs(turn) > Math.PI ? Math.sign(turn) * TURN : 0;
  return { i, x: robot.x[i] + part * (robot.x[j] - robot.x[i]), y: robot.y[i] + part * (robot.y[j] - robot.y[i]), heading: robot.heading[i] + part * turn };
}

function moverAt(mover, t) {
  if (!mover.legs) {
    const points = mover.cyclic ? [...mover.points, mover.points[0]] : mover.points;
    mover.legs = points.slice(1).map((to, i) => ({ from: points[i], to, time: Math.hypot(to[0] - points[i][0], to[1] - points[i][1]) / mover.speeds[i] }));
    if (!mover.cyclic) mover.legs.push(...mover.legs.map(leg => ({ from: leg.to, to: leg.from, time: leg.time })).reverse());
    mover.round = mover.legs.reduce((sum, leg) => sum + leg.time, 0);
  }
  let clock = (t + mover.phase) % mover.round;
  for (const { from, to, time } of mover.legs) {
    if (clock < time) return [from[0] + (to[0] - from[0]) * clock / time, from[1] + (to[1] - from[1]) * clock / time];
    clock -= time;
  }
  return mover.legs[0].from;
}

// Rays, as the simulator casts them: from a point along a unit vector to the first thing, Infinity where there is none.
function toDisc(px, py, ux, uy, [x, y, radius]) {
  const dx = x - px, dy = y - py, along = dx * ux + dy * uy, gap = dx * dx + dy * dy - radius * radius;
  const root = along * along - gap;
  return gap <= 0 ? 0 : along > 0 && root >= 0 ? along - Math.sqrt(root) : Infinity;
}

function toSegment(px, py, ux, uy, [ax, ay], [bx, by]) {
  const sx = bx - ax, sy = by - ay, cross = ux * sy - uy * sx;
  if (cross === 0) return Infinity;
  const t = ((ax - px) * sy - (ay - py) * sx) / cross, s = ((ax - px) * uy - (ay - py) * ux) / cross;
  return t >= 0 && s >= 0 && s <= 1 ? t : Infinity;
}

function toCells(px, py, ux, uy, far, grid) { // from cell to cell
  let x = (px - grid.x) / grid.side, y = (py - grid.y) / grid.side, t = 0;
  const limit = far / grid.side;
  const ends = [[x, ux, grid.width], [y, uy, grid.height]].map(([at, u, size]) =>
    u === 0 ? (at < 0 || at >= size ? [Infinity, -Infinity] : [-Infinity, Infinity]) : [-at / u, (size - at) / u].sort((a, b) => a - b));
  t = Math.max(0, ends[0][0], ends[1][0]);
  const out = Math.min(limit, ends[0][1], ends[1][1]);
  if (t > out) return Infinity;
  let i = Math.min(Math.max(Math.floor(x + t * ux), 0), grid.width - 1), j = Math.min(Math.max(Math.floor(y + t * uy), 0), grid.height - 1);
  while (t <= out && i >= 0 && j >= 0 && i < grid.width && j < grid.height) {
    if (grid.at(i, j)) return t * grid.side;
    const tx = ux ? (i + (ux > 0) - x) / ux : Infinity, ty = uy ? (j + (uy > 0) - y) / uy : Infinity;
    if (tx < ty) { t = tx; i += Math.sign(ux); } else { t = ty; j += Math.sign(uy); }
  }
  return Infinity;
}

const cornersOf = ([x, y, length, width, cos, sin]) => [[1, 1], [-1, 1], [-1, -1], [1, -1]]
  .map(([a, b]) => [x + a * length * cos - b * width * sin, y + a * length * sin + b * width * cos]);

function obstaclesAt(layout, t) {
  const moving = layout.movers.map(mover => [...moverAt(mover, t), mover]);
  return {
    discs: [...layout.discs, ...moving.filter(([, , mover]) => !mover.outline.length).map(([x, y, mover]) => [x, y, mover.radius])],
    outlines: [...layout.boxes.map(cornersOf), ...layout.polygons, ...moving.filter(([, , mover]) => mover.outline.length)
      .map(([x, y, mover]) => mover.outline.map(([a, b]) => [x + a, y + b]))],
    grid: layout.grid,
  };
}

function cast(px, py, angle, far, { discs, outlines, grid }) {
  const ux = Math.cos(angle), uy = Math.sin(angle);
  let nearest = far;
  for (const disc of discs) nearest = Math.min(nearest, toDisc(px, py, ux, uy, disc));
  for (const corners of outlines) corners.forEach((a, i) => { nearest = Math.min(nearest, toSegment(px, py, ux, uy, a, corners[(i + 1) % corners.length])); });
  return grid ? Math.min(nearest, toCells(px, py, ux, uy, far, grid)) : nearest;
}

async function begin() {
  unpackStates(await inflated(DATA.states));
  const layouts = await unpackLayouts(await inflated(DATA.layouts));
  const { cells, episodes, colours } = DATA;
  const labels = [...new Set(cells.map(cell => cell.label))];
  const id = name => document.getElementById(name);
  const scene = id("scene"), time = id("time"), play = id("play");
  let episode = episodes[0], chosen = 0, t = 0, end = 1, over = [], running = 0, view = null, still = null, ink = {};

  const cellOf = of => cells[of.cell], layout = () => layouts[episode.layout];
  const colour = number => colours[number % colours.length] === GREY ? ink.muted : colours[number % colours.length];
  const isFleet = () => episode.robots.length > 1; // in which a robot has a colour of its own, elsewhere a controller
  const colourOf = (of, k) => isFleet() ? of === episode ? colour(k) : ink.muted : colour(labels.indexOf(cellOf(of).label));
  const failed = of => of.robots.some(robot => robot.outcome !== "reached");
  const readInk = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["paper", "ink", "muted", "line", "obstacle", "wall", "mover", "goal", "ray", "robot", "bad"]) ink[name] = style.getPropertyValue(`--${name}`).trim();
  };

  function sized(canvas, height) { // for the screen's own dots
    const dots = devicePixelRatio || 1, width = canvas.clientWidth;
    canvas.style.height = height ? `${height}px` : "";
    canvas.width = Math.round(width * dots);
    canvas.height = Math.round((height || canvas.clientHeight) * dots);
    const context = canvas.getContext("2d");
    context.setTransform(dots, 0, 0, dots, 0, 0);
    return context;
  }

  function fit() { // the bounds and what was driven beyond them, or only what was driven
    const near = id("near").checked, driven = near ? [episode, ...over] : [episode], [l, r, b, t] = layout().bounds;
    const spread = (name, ends) => extent([...(near ? [] : ends), ...driven.flatMap(of => of.robots).flatMap(robot => extent(robot[name]))].filter(Number.isFinite));
    const [left, right] = spread("x", [l, r]), [bottom, top] = spread("y", [b, t]), { radius } = cellOf(episode);
    const margin = Math.max(0.03 * Math.max(right - left, top - bottom), near ? 2 * radius : 0), width = scene.clientWidth;
    const wide = right - left + 2 * margin, high = top - bottom + 2 * margin;
    const scale = Math.min(width / wide, 0.75 * innerHeight / high, 700 / high), height = Math.max(scale * high, 120);
    return { scale, width, height, x: (width - scale * (left + right)) / 2, y: (height + scale * (bottom + top)) / 2 };
  }

  const world = context => context.transform(view.scale, 0, 0, -view.scale, view.x, view.y);
  const disc = (context, x, y, radius) => { context.beginPath(); context.arc(x, y, radius, 0, TURN); };
  const outline = (context, points) => { context.beginPath(); for (const point of points) context.lineTo(...point); context.closePath(); };

  function drawStill() { // all that does not move, once
    readInk();
    view = fit();
    sized(scene, view.height);
    still = document.createElement("canvas");
    still.width = scene.width;
    still.height = scene.height;
    const context = still.getContext("2d"), dots = devicePixelRatio || 1, pixel = 1 / view.scale, { grid } = layout();
    context.setTransform(dots, 0, 0, dots, 0, 0);
    context.fillStyle = ink.paper;
    context.fillRect(0, 0, view.width, view.height);
    context.save();
    world(context);
    context.lineWidth = pixel;
    const [left, right, bottom, top] = layout().bounds;
    context.strokeStyle = ink.line;
    context.strokeRect(left, bottom, right - left, top - bottom);
    context.fillStyle = ink.goal;
    layout().goals.forEach(([x, y]) => { disc(context, x, y, cellOf(episode).tolerance); context.fill(); });
    context.fillStyle = ink.obstacle;
    for (const corners of [...layout().boxes.map(cornersOf), ...layout().polygons]) { outline(context, corners); context.fill(); }
    for (const one of layout().discs) { disc(context, ...one); context.fill(); }
    if (grid) {
      for (let j = 0; j < grid.height; j++) {
        for (let i = 0; i < grid.width; i++) {
          const from = i;
          while (i < grid.width && grid.at(i, j)) i++;
          if (i > from) context.fillRect(grid.x + from * grid.side, grid.y + j * grid.side, (i - from) * grid.side, grid.side);
        }
      }
    }
    if (layout().line.length) {
      context.strokeStyle = ink.ink;
      context.setLineDash([4 * pixel, 4 * pixel]);
      const [ax, ay, bx, by] = layout().line;
      context.stroke(new Path2D(`M${ax} ${ay}L${bx} ${by}`));
      context.setLineDash([]);
    }
    context.lineWidth = 1.3 * pixel;
    context.globalAlpha = Math.max(0.3, Math.min(0.8, 6 / (over.length || 1)));
    for (const other of over) {
      context.strokeStyle = colourOf(other);
      other.robots.forEach(robot => context.stroke(robot.path));
    }
    context.globalAlpha = 1;
    episode.robots.forEach((robot, k) => {
      context.lineWidth = 2 * pixel;
      context.strokeStyle = colourOf(episode, k);
      context.stroke(robot.path);
    });
    context.restore();
    for (const of of [...over, episode]) {
      for (const robot of of.robots) {
        if (robot.outcome === "reached" || !robot.n) continue;
        const x = view.scale * robot.x[robot.n - 1] + view.x, y = view.y - view.scale * robot.y[robot.n - 1];
        context.strokeStyle = ink.bad;
        context.lineWidth = of === episode ? 3 : 1.5;
        context.stroke(new Path2D(`M${x - 5} ${y - 5}l10 10m0 -10l-10 10`));
      }
    }
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find(step => step * view.scale > 50) || 100;
    context.strokeStyle = context.fillStyle = ink.ink;
    context.lineWidth = 2;
    context.stroke(new Path2D(`M10 ${view.height - 10}h${step * view.scale}`));
    context.font = "12px system-ui, sans-serif";
    context.fillText(`${step} m`, 12, view.height - 15);
  }

  function drawRobot(context, of, robot, k, strong) {
    if (!robot.n) return;
    const { x, y, heading } = poseAt(robot, t), { radius } = cellOf(of), pixel = 1 / view.scale, shown = Math.max(radius, 3 * pixel);
    disc(context, x, y, shown);
    context.lineWidth = (strong ? 2.5 : 1) * pixel;
    context.strokeStyle = colourOf(of, k);
    if (of === episode) { context.fillStyle = ink.robot; context.fill(); }
    context.stroke();
    context.stroke(new Path2D(`M${x} ${y}L${x + shown * Math.cos(heading)} ${y + shown * Math.sin(heading)}`));
  }

  function drawRays(context) {
    const robot = episode.robots[chosen], cell = cellOf(episode), pixel = 1 / view.scale, readings = [];
    if (!robot.n) return readings;
    const at = poseAt(robot, t), recorded = robot.ranges.length > 0;
    const [x, y, heading] = recorded ? [robot.x[at.i], robot.y[at.i], robot.heading[at.i]] : [at.x, at.y, at.heading];
    const cos = Math.cos(heading), sin = Math.sin(heading), seen = obstaclesAt(layout(), t);
    seen.discs = [...seen.discs, ...episode.robots.filter(other => other !== robot && other.n).map(other => { const at = poseAt(other, t); return [at.x, at.y, cell.radius]; })];
    context.strokeStyle = ink.ray;
    context.lineWidth = pixel;
    context.globalAlpha = cell.mounts.length > 40 ? 0.35 : 0.8;
    context.beginPath();
    for (const [m, [role, mx, my, looks, far, half, rays]] of cell.mounts.entries()) {
      const px = x + mx * cos - my * sin, py = y + mx * sin + my * cos;
      const read = recorded ? robot.ranges[m][at.i] : undefined; // NaN at the end
      let nearest = far;
      for (let k = 0; k < (recorded ? !Number.isNaN(read) : rays); k++) {
        const angle = heading + looks + (!recorded && rays > 1 ? half * (2 * k / (rays - 1) - 1) : 0), reach = recorded ? read : cast(px, py, angle, far, seen);
        context.moveTo(px, py);
        context.lineTo(px + reach * Math.cos(angle), py + reach * Math.sin(angle));
        nearest = Math.min(nearest, reach);
      }
      if (nearest < far - 5e-4) readings.push([nearest, role]);
    }
    context.stroke();
    context.globalAlpha = 1;
    return readings.sort(([a], [b]) => a - b);
  }

  function activeAt(robot, i) { // what the trace's whole numbers say of this instant
    const told = [];
    for (const [name, , quantum] of robot.traces) {
      const value = robot.trace[name][i];
      if (quantum !== 1 || Number.isNaN(value)) continue;
      const word = cellOf(episode).words[name]?.[value], flag = robot.flags?.has(name);
      if (word !== undefined) told.push(...word ? [word] : []);
      else if (name.startsWith("active_") && flag) { if (value) told.push(name.slice(7)); }
      else if (/behaviou?r|agent|mode|phase|active/.test(name)) told.push(`${name} ${value}`);
      else if (flag && value) told.push(name);
    }
    return told.map(word => word.replaceAll("_", " "));
  }

  function draw() {
    const context = scene.getContext("2d");
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(still, 0, 0);
    context.restore();
    context.save();
    world(context);
    context.fillStyle = ink.mover;
    for (const mover of layout().movers) {
      const [x, y] = moverAt(mover, t);
      if (mover.outline.length) outline(context, mover.outline.map(([a, b]) => [x + a, y + b]));
      else disc(context, x, y, mover.radius);
      context.fill();
    }
    const readings = id("rays").checked ? drawRays(context) : [];
    for (const other of over) other.robots.forEach((robot, k) => drawRobot(context, other, robot, k, false));
    episode.robots.forEach((robot, k) => drawRobot(context, episode, robot, k, k === chosen));
    context.restore();
    const robot = episode.robots[chosen];
    time.value = t;
    time.setAttribute("aria-valuetext", `${t.toFixed(2)} s`);
    id("clock").value = `${t.toFixed(2)} s`;
    if (!robot.n) return;
    const { i, x, y, heading } = poseAt(robot, t), active = activeAt(robot, i);
    const state = t >= lastOf(robot) ? `${robot.outcome.replaceAll("_", " ")} at ${lastOf(robot).toFixed(2)} s` : `v ${robot.v[i].toFixed(3)} m/s, w ${robot.w[i].toFixed(3)} rad/s`;
    id("instant").textContent = `Robot ${robot.robot + 1} at (${x.toFixed(2)}, ${y.toFixed(2)}) m, heading ${(heading * 360 / TURN).toFixed(0)}°: ${state}.`
      + (active.length ? ` Active: ${active.join(", ")}.` : "")
      + (readings.length ? ` Nearest, ${robot.ranges.length ? "as recorded" : "cast here without noise"}: ${readings.slice(0, 3).map(([reach, role]) => `${role} ${reach.toFixed(2)} m`).join(", ")}.` : "");
    scene.setAttribute("aria-label", `The scene at ${t.toFixed(2)} s. ${id("instant").textContent}`);
    plot(id("plot-v"), robot, robot.v);
    plot(id("plot-w"), robot, robot.w);
    plot(id("plot-trace"), robot, robot.trace[id("trace").value] || new Float64Array(0));
  }

  function plot(canvas, robot, values) { // held over each control period, with a cursor at this instant
    const context = sized(canvas), width = canvas.clientWidth, height = canvas.clientHeight;
    const there = values.filter(Number.isFinite);
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = ink.muted;
    if (!there.length) return;
    let low = Math.min(0, ...extent(there)), high = Math.max(0, ...extent(there));
    if (high === low) high = low + 1;
    const at = (second, value) => [8 + (width - 16) * second / end, height - 16 - (height - 32) * (value - low) / (high - low)];
    context.strokeStyle = ink.line;
    context.beginPath();
    context.moveTo(...at(0, 0));
    context.lineTo(...at(end, 0));
    context.stroke();
    context.strokeStyle = colourOf(episode, chosen);
    context.lineWidth = 1.5;
    context.beginPath();
    for (let i = 0; i + 1 < robot.n; i++) {
      if (!Number.isFinite(values[i])) continue;
      context.lineTo(...at(robot.t[i], values[i]));
      context.lineTo(...at(robot.t[i + 1], values[i]));
    }
    context.stroke();
    context.strokeStyle = ink.ink;
    context.lineWidth = 1;
    context.stroke(new Path2D(`M${at(t, 0)[0]} 0V${height}`));
    const now = values[Math.min(indexAt(robot, t), Math.max(robot.n - 2, 0))];
    context.fillText(`${+high.toPrecision(4)}`, 4, 12);
    context.fillText(`${+low.toPrecision(4)}`, 4, height - 3);
    context.fillText(`${end.toFixed(1)} s`, width - 40, height - 3);
    one("output", canvas.parentElement).value = Number.isFinite(now) ? `${+now.toPrecision(4)}` : "";
  }

  function extent(values) {
    let low = Infinity, high = -Infinity;
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    return [low, high];
  }

  function redraw() { drawStill(); draw(); }

  function overlay() {
    const wanted = id("over").value, cell = cellOf(episode);
    over = episodes.filter(other => other !== episode && other.layout === episode.layout && wanted && (
      wanted === "all" || wanted === "cell" && cellOf(other).label === cell.label
      || wanted === "start" && other.episode === episode.episode && cellOf(other).seed === cell.seed && cellOf(other).world === cell.world));
    end = Math.max(1e-3, ...[episode, ...over].flatMap(of => of.robots).filter(robot => robot.n).map(lastOf));
    time.max = end;
    legend();
  }

  function legend() {
    const lines = isFleet()
      ? [...episode.robots.map((robot, k) => [colour(k), `robot ${robot.robot + 1}: ${robot.outcome.replaceAll("_", " ")}`]),
        ...over.length ? [[ink.muted, `other episodes: ${over.length}`]] : []]
      : [...new Set([episode, ...over].map(of => cellOf(of).label))].map(label => {
        const of = [episode, ...over].filter(of => cellOf(of).label === label);
        return [colour(labels.indexOf(label)), `${label}: ${of.filter(failed).length} of ${of.length} shown failed`];
      });
    id("legend").replaceChildren(...lines.map(([colour, text]) => {
      const item = document.createElement("li"), name = "http://www.w3.org/2000/svg";
      const mark = document.createElementNS(name, "svg"), line = document.createElementNS(name, "line");
      for (const [key, value] of Object.entries({ x1: 0, x2: 26, y1: 7, y2: 7, "stroke-width": 4, stroke: colour })) line.setAttribute(key, value);
      mark.setAttribute("aria-hidden", "true");
      mark.append(line);
      item.append(mark, text);
      return item;
    }));
  }

  function show(place, robot, at) {
    stop();
    episode = episodes[place];
    chosen = Math.max(0, episode.robots.findIndex(one => one.robot === robot));
    const cell = cellOf(episode);
    id("which").textContent = `${cell.label} in ${cell.world}, ${cell.simulator}, seed ${cell.seed}, episode ${episode.episode}`;
    id("robot").replaceChildren(...episode.robots.map((one, k) => new Option(`${one.robot + 1}: ${one.outcome.replaceAll("_", " ")}`, k)));
    pick(chosen, false);
    overlay();
    t = Math.min(at ?? 0, end);
    history.replaceState(null, "", `#play-${place}-${episode.robots[chosen].robot}`);
    redraw();
  }

  function pick(k, redrawn = true) { // a robot
    chosen = k;
    const robot = episode.robots[k], names = robot.traces.map(([name]) => name), before = id("trace").value;
    robot.flags ??= new Set(names.filter(name => robot.trace[name].every(value => value === 0 || value === 1 || Number.isNaN(value))));
    id("robot").value = k;
    id("trace").replaceChildren(...names.map(name => new Option(name, name)));
    if (names.includes(before)) id("trace").value = before;
    const row = all("#rows button").find(button => +button.dataset.place === episodes.indexOf(episode) && +button.dataset.robot === robot.robot)?.closest("tr");
    for (const other of all("#rows tr[aria-current]")) other.removeAttribute("aria-current");
    row?.setAttribute("aria-current", "true");
    const raised = row && one("pre", row);
    id("raised").hidden = !raised;
    one("pre", id("raised")).textContent = raised ? raised.textContent : "";
    if (redrawn) draw();
  }

  function stop() {
    cancelAnimationFrame(running);
    running = 0;
    play.textContent = "Play";
  }

  function start() {
    if (t >= end) t = 0;
    play.textContent = "Pause";
    let before = performance.now();
    const step = now => {
      t = Math.min(t + (now - before) / 1000 * id("speed").value, end);
      before = now;
      draw();
      if (t < end) running = requestAnimationFrame(step); else stop();
    };
    running = requestAnimationFrame(step);
  }

  function failure(step) { // the next or the previous episode that failed
    const from = episodes.indexOf(episode), count = episodes.length;
    for (let k = 1; k <= count; k++) {
      const place = (from + k * step + k * count) % count;
      if (failed(episodes[place])) return show(place, episodes[place].robots.find(robot => robot.outcome !== "reached").robot);
    }
  }

  function seek(second) { stop(); t = Math.max(0, Math.min(second, end)); draw(); }

  play.addEventListener("click", () => running ? stop() : start());
  time.addEventListener("input", () => seek(+time.value));
  time.addEventListener("keydown", event => {
    const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
    if (step) { event.preventDefault(); seek(t + step * end / 200); }
  });
  id("player").addEventListener("keydown", event => {
    if (event.key === " " && !event.target.closest("button, select, input, summary")) { event.preventDefault(); play.click(); }
  });
  id("previous").addEventListener("click", () => failure(-1));
  id("next").addEventListener("click", () => failure(1));
  id("robot").addEventListener("input", () => pick(+id("robot").value));
  id("over").addEventListener("input", () => { overlay(); t = Math.min(t, end); redraw(); });
  id("rays").addEventListener("input", draw);
  id("near").addEventListener("input", redraw);
  id("trace").addEventListener("input", draw);
  id("rows").addEventListener("click", event => {
    const button = event.target.closest("details") ? null : one("button[data-place]", event.target.closest("tbody tr") || id("play").parentElement);
    if (button) { show(+button.dataset.place, +button.dataset.robot); id("player").scrollIntoView({ block: "nearest" }); }
  });
  scene.addEventListener("click", event => { // the nearest robot
    const x = (event.offsetX - view.x) / view.scale, y = (view.y - event.offsetY) / view.scale;
    const away = episode.robots.map((robot, k) => { const at = robot.n ? poseAt(robot, t) : { x: Infinity, y: 0 }; return [Math.hypot(at.x - x, at.y - y), k]; });
    pick(away.sort(([a], [b]) => a - b)[0][1]);
  });
  for (const canvas of ["plot-v", "plot-w", "plot-trace"].map(id)) {
    const to = event => seek((event.offsetX - 8) / (canvas.clientWidth - 16) * end);
    canvas.addEventListener("pointerdown", to);
    canvas.addEventListener("pointermove", event => { if (event.buttons) to(event); });
  }
  addEventListener("resize", redraw);
  addEventListener("beforeprint", redraw);
  addEventListener("afterprint", redraw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  readInk();
  id("player").hidden = false;
  const wanted = /^#play-(\d+)-(\d+)$/.exec(location.hash), place = wanted ? +wanted[1] : 0;
  show(place < episodes.length ? place : 0, wanted ? +wanted[2] : episodes[0].robots.find(robot => robot.outcome !== "reached")?.robot ?? 0);
  if (!wanted) history.replaceState(null, "", location.pathname + location.search);
}

if (DATA.episodes.length) begin();

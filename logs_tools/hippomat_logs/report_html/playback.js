// Moves what has a time: robots, trails, planned ways, tasks, the lines at the present. Reads the JSON in #motion
// and the figures' own columns; draw(t) is the only place that shows another time.
"use strict";
(() => {
  const motion = JSON.parse(document.getElementById("motion").textContent);
  const element = (id) => document.getElementById(id);
  const slider = element("time"), play = element("play"), clock = element("clock"), speed = element("speed");
  const KEPT_S = 3;  // for so long a served task stays on the map
  const LABEL_PX = 34, BESIDE_PX = 110;  // of a task's number; of a time axis' own labels and tools

  // The last row whose first entry is not after t; rows are in the order of their times.
  function lastBefore(rows, t) {
    let low = 0, high = rows.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (rows[middle][0] <= t) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  function spanAt(robot, t) {
    const span = robot.spans[lastBefore(robot.spans, t)];
    return span && t <= span[1] + 1 ? span : null;
  }

  function poseAt(tracks, robot, t) {
    const xs = tracks.xs[robot], ys = tracks.ys[robot], yaws = tracks.yaws[robot];
    const at = Math.min(t / motion.step_s, xs.length - 1), k = Math.floor(at), next = Math.min(k + 1, xs.length - 1);
    const share = Number.isNaN(xs[next]) ? 0 : at - k;
    const turn = Math.atan2(Math.sin(yaws[next] - yaws[k]), Math.cos(yaws[next] - yaws[k]));
    const between = (a, b) => (share ? a + share * (b - a) : a);
    return {x: between(xs[k], xs[next]), y: between(ys[k], ys[next]), yaw: yaws[k] + (share ? share * turn : 0)};
  }

  function describe(robot, t) {
    const span = spanAt(robot, t);
    if (!span) return "-";
    const text = motion.texts[motion.phases[span[2]]];
    return span[3] < 0 ? text : `${span[3]}·${span[4]}: ${text}`;
  }

  function robotColumns(tracks, t) {
    const columns = {x: [], y: [], hx: [], hy: [], xs: [], ys: [], name: [], colour: [], rim: [], rim_px: [], text: []};
    motion.robots.forEach((robot, k) => {
      const {x, y, yaw} = poseAt(tracks, k, t), c = Math.cos(yaw), s = Math.sin(yaw);
      if (Number.isNaN(x)) return;
      const span = spanAt(robot, t), phase = span ? motion.phases[span[2]] : "";
      columns.x.push(x);
      columns.y.push(y);
      columns.hx.push(x + c * robot.front_m);
      columns.hy.push(y + s * robot.front_m);
      columns.xs.push(robot.outline.map(([u, v]) => x + c * u - s * v));
      columns.ys.push(robot.outline.map(([u, v]) => y + s * u + c * v));
      columns.name.push(robot.name);
      columns.colour.push(robot.colour);
      const minded = ["stopped", "lost", "recovery"].includes(phase);
      columns.rim.push(minded ? "#1F2733" : robot.colour);
      columns.rim_px.push(minded ? 2.5 : 1);
      columns.text.push(describe(robot, t));
    });
    return columns;
  }

  function trailColumns(tracks, t) {
    const last = Math.floor(t / motion.step_s) + 1, first = Math.max(0, last - Math.ceil(motion.trail_s / motion.step_s));
    return {
      xs: motion.robots.map((_, k) => tracks.xs[k].slice(first, last)),
      ys: motion.robots.map((_, k) => tracks.ys[k].slice(first, last)),
      colour: motion.robots.map((robot) => robot.colour),
    };
  }

  // The planned path that holds, for robots with a claim; a line to the destination where the plan is not known.
  function wayColumns(tracks, t) {
    const columns = {xs: [], ys: [], colour: []};
    motion.robots.forEach((robot, k) => {
      const span = spanAt(robot, t), way = robot.ways[lastBefore(robot.ways, t)], pose = poseAt(tracks, k, t);
      if (!span || span[3] < 0) return;
      const line = way && way[1].length ? ahead(way, pose) : [[pose.x, span[5]], [pose.y, span[6]]];
      columns.xs.push(line[0]);
      columns.ys.push(line[1]);
      columns.colour.push(robot.colour);
    });
    return columns;
  }

  // What is left of a path: from the robot to the end, without the corners that lie behind it.
  function ahead(way, pose) {
    const [, xs, ys] = way;
    let nearest = 0, least = Infinity;
    for (let k = 0; k + 1 < xs.length; k++) {
      const dx = xs[k + 1] - xs[k], dy = ys[k + 1] - ys[k], along = (pose.x - xs[k]) * dx + (pose.y - ys[k]) * dy;
      const share = Math.min(Math.max(along / (dx * dx + dy * dy), 0), 1);
      const away = Math.hypot(pose.x - xs[k] - share * dx, pose.y - ys[k] - share * dy);
      if (away < least) [least, nearest] = [away, k];
    }
    return [[pose.x, ...xs.slice(nearest + 1)], [pose.y, ...ys.slice(nearest + 1)]];
  }

  function taskColumns(t) {
    const columns = {x: [], y: [], fill: [], line: [], alpha: [], size: [], mark: [], label: [], text: []};
    const add = (x, y, fill, line, mark, label, text) => {
      if (x === null || y === null) return;
      const row = {x, y, fill, line, alpha: 1, size: 14, mark, label, text};
      for (const key in columns) columns[key].push(row[key]);
    };
    const claimed = new Set();
    for (const robot of motion.robots) {
      const span = spanAt(robot, t);
      if (!span || span[3] < 0) continue;
      const confirmed = ["confirmed", "serving"].includes(motion.phases[span[2]]);
      claimed.add(`${span[3]}·${span[4]}`);
      add(span[5], span[6], confirmed ? robot.colour : "#FFFFFF", robot.colour, "diamond", `${span[3]}`,
        `${span[3]}·${span[4]}, ${confirmed ? "confirmed" : "claimed"} by robot ${robot.name}`);
    }
    for (const [slot, generation, x, y, seen, closed, completed, by] of motion.tasks) {
      const name = `${slot}·${generation}`;
      if (completed <= t && t < completed + KEPT_S) {
        add(x, y, by, by, "cross", "", `${name}, served`);
      } else if (seen <= t && t < closed && t < completed && !claimed.has(name)) {
        add(x, y, "#FFFFFF", "#1F2733", "diamond", `${slot}`, `${name}, open`);
      }
    }
    return columns;
  }

  function start(doc) {
    const source = (name) => doc.get_model_by_name(name);
    const tracks = source("tracks").data;
    const TIMED = ["gantt", "events"].filter(source);  // figures over time; without an event there is none
    const rows = [...document.querySelectorAll("#now td")];
    let now = 0, playing = false, before = 0;

    function draw(t) {
      now = Math.min(Math.max(t, 0), motion.span_s);
      source("robots").data = robotColumns(tracks, now);
      source("trails").data = trailColumns(tracks, now);
      source("ways").data = wayColumns(tracks, now);
      source("tasks").data = taskColumns(now);
      TIMED.forEach(point);
      motion.robots.forEach((robot, k) => { rows[k].textContent = describe(robot, now); });
      clock.textContent = `${now.toFixed(1)} s`;
      slider.value = now;
      slider.setAttribute("aria-valuetext", `${now.toFixed(1)} seconds of ${motion.span_s.toFixed(1)}`);
    }

    // The line at the present time is no part of a figure: moving it must not paint a thousand bars again.
    function point(name) {
      const view = window.Bokeh.index.find_one(source(name)), line = element(`cursor_${name}`);
      const box = view.frame.bbox, x = view.frame.x_scale.compute(now);
      line.hidden = x < box.left || x > box.right;
      line.style.left = `${view.el.offsetLeft + x}px`;
      line.style.top = `${view.el.offsetTop + box.top}px`;
      line.style.height = `${box.height}px`;
    }

    function frame(stamp) {
      if (!playing) return;
      draw(now + (stamp - before) / 1e3 * Number(speed.value));
      before = stamp;
      if (now >= motion.span_s) toggle(); else requestAnimationFrame(frame);
    }

    function toggle() {
      playing = !playing;
      play.textContent = playing ? "❚❚" : "▶";
      play.setAttribute("aria-label", playing ? "Pause" : "Play");
      play.setAttribute("aria-pressed", playing);
      if (!playing) return;
      if (now >= motion.span_s) draw(0);
      requestAnimationFrame((stamp) => { before = stamp; requestAnimationFrame(frame); });
    }

    // After zooming and resizing. Numbers only on bars that have room for them.
    function arrange() {
      const range = source("time"), labels = source("labels");
      const wide = LABEL_PX * (range.end - range.start) / Math.max(play.parentElement.clientWidth - BESIDE_PX, 1);
      const {label, room} = labels.data;
      labels.data = {...labels.data, shown: label.map((text, k) => (room[k] >= wide ? text : ""))};
      TIMED.forEach(point);
    }

    play.addEventListener("click", toggle);
    slider.addEventListener("input", () => draw(Number(slider.value)));
    for (const name of TIMED) source(name).on_event("tap", (event) => draw(event.x));
    for (const button of document.querySelectorAll(".go")) {
      button.addEventListener("click", () => draw(Number(button.dataset.at)));
    }
    source("time").properties.start.change.connect(arrange);
    source("time").properties.end.change.connect(arrange);
    window.addEventListener("resize", arrange);
    for (const name of TIMED) source(name).properties.inner_width.change.connect(() => point(name));
    arrange();
    draw(0);
    window.hippomatReport = {draw, doc};  // for tests, and for whoever opens the console
  }

  const waiting = setInterval(() => {
    const doc = window.Bokeh?.documents[0];
    if (doc && doc.is_idle) {
      clearInterval(waiting);
      start(doc);
    }
  }, 20);
})();

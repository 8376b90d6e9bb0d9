// The measured points in space, to be turned, zoomed and played. Plain
// JavaScript on a canvas; the numbers stand in the page as JSON (see
// space_view.py for their meaning). Lengths in the data are 0.01 mm.
"use strict";
(() => {
  const COLOURS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const STEPS = 64;
  const mix = (share) => {
    const place = Math.min(Math.max(share, 0), 1) * (COLOURS.length - 1);
    const low = Math.min(Math.floor(place), COLOURS.length - 2);
    const part = COLOURS[low].map((c, i) => Math.round(c + (place - low) * (COLOURS[low + 1][i] - c)));
    return `rgb(${part.join(",")})`;
  };
  const RAMP = Array.from({ length: STEPS }, (_, i) => mix(i / (STEPS - 1)));
  const VIEWS = { front: [0, 0], right: [-Math.PI / 2, 0], top: [0, Math.PI / 2], free: [-0.6, 0.28] };
  const TRAIL = 40;

  const start = (root) => {
    const data = JSON.parse(root.querySelector("script[type='application/json']").textContent);
    const canvas = root.querySelector("canvas");
    const pen = canvas.getContext("2d");
    const find = (name) => root.querySelector(`[data-is="${name}"]`);
    const slider = find("stage"), readout = find("readout"), playButton = find("play");
    const shows = (name) => { const box = find(name); return box !== null && box.checked; };
    const points = data.ids.length, stages = data.stages.length;
    const reference = data.reference;
    // Points that stand still have values of their own, and neither stages nor displacements.
    const still = data.values !== undefined;
    const state = { row: data.first, turn: VIEWS.free[0], tilt: VIEWS.free[1], zoom: 1, pan: [0, 0],
      playing: false, began: 0, from: 0, hover: -1, width: 1, height: 1 };

    // Position of point p at row s as [right, up, away] in 0.01 mm, or null.
    const at = (s, p) => {
      const x = data.points[s][3 * p];
      return x === null ? null : [x, data.points[s][3 * p + 1], data.points[s][3 * p + 2]];
    };
    const extent = (withCameras) => {
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      const hold = (xyz) => {
        if (xyz === null) return;
        for (let i = 0; i < 3; i++) {
          low[i] = Math.min(low[i], xyz[i]);
          high[i] = Math.max(high[i], xyz[i]);
        }
      };
      for (let s = 0; s < stages; s++) for (let p = 0; p < points; p++) hold(at(s, p));
      for (const line of data.outline) line.forEach(hold);
      if (withCameras) for (const camera of data.cameras) camera.corners.forEach(hold);
      if (!(low[0] <= high[0])) return { middle: [0, 0, 0], wide: 1, tall: 1 };
      const [wide, tall, deep] = low.map((v, i) => high[i] - v);
      const middle = low.map((v, i) => (v + high[i]) / 2);
      return { middle, wide: Math.hypot(wide, deep) || 1, tall: tall || 1 };
    };
    const near = extent(false), far = extent(true);
    let held = shows("cameras") ? far : near;

    // Orthographic: turned about the vertical, then tilted towards the viewer.
    const projector = () => {
      const ct = Math.cos(state.turn), st = Math.sin(state.turn);
      const ce = Math.cos(state.tilt), se = Math.sin(state.tilt);
      // What is held fits whatever the turn; the legend stands below it.
      const needed = Math.abs(ce) * held.tall + Math.abs(se) * held.wide;
      const scale = state.zoom * Math.min((state.width - 80) / held.wide, (state.height - 90) / needed);
      const cx = state.width / 2 + state.pan[0], cy = state.height / 2 - 10 + state.pan[1];
      const project = (xyz) => {
        const x = xyz[0] - held.middle[0], y = xyz[1] - held.middle[1], z = xyz[2] - held.middle[2];
        const right = ct * x - st * z, away = st * x + ct * z;
        return [cx + scale * right, cy - scale * (ce * y + se * away), ce * away - se * y];
      };
      return { project, scale };
    };

    const polyline = (project, line, closed) => {
      pen.beginPath();
      line.forEach((xyz, i) => {
        const [x, y] = project(xyz);
        if (i) pen.lineTo(x, y); else pen.moveTo(x, y);
      });
      if (closed) pen.closePath();
      pen.stroke();
    };

    const drawGround = (project) => {
      if (data.ground === null) return;
      const half = 0.4 * Math.max(near.tall, near.wide), [mx, , mz] = near.middle;
      pen.lineWidth = 1;
      pen.strokeStyle = "rgba(125,138,160,0.32)";
      for (let i = -4; i <= 4; i++) {
        const d = (i / 4) * half;
        polyline(project, [[mx + d, data.ground, mz - half], [mx + d, data.ground, mz + half]], false);
        polyline(project, [[mx - half, data.ground, mz + d], [mx + half, data.ground, mz + d]], false);
      }
    };

    const drawOutline = (project) => {
      if (!data.outline.length) return;
      const way = data.centroid[state.row] || [0, 0, 0];
      pen.strokeStyle = "rgba(150,163,184,0.55)";
      pen.lineWidth = 1.2;
      for (const line of data.outline) {
        polyline(project, line.map((xyz) => {
          const y = xyz[1] + way[1];
          return [xyz[0] + way[0], data.ground === null ? y : Math.max(y, data.ground), xyz[2] + way[2]];
        }), false);
      }
    };

    const drawCameras = (project) => {
      if (!shows("cameras")) return;
      pen.strokeStyle = "#8fa0bb";
      pen.fillStyle = "#c3cddc";
      pen.lineWidth = 1.2;
      pen.textAlign = "center";
      const written = []; // a name that would stand on another is left out
      for (const camera of data.cameras) {
        const [apex, ...ring] = camera.corners;
        polyline(project, ring, true);
        for (const corner of ring) polyline(project, [apex, corner], false);
        const drawnAt = camera.corners.map(project);
        const x = drawnAt[0][0], y = Math.max(...drawnAt.map((c) => c[1])) + 15;
        const half = pen.measureText(camera.name).width / 2 + 3;
        if (written.some(([left, right, at]) => x + half > left && x - half < right && Math.abs(y - at) < 13)) continue;
        written.push([x - half, x + half, y]);
        pen.fillText(camera.name, x, y);
      }
    };

    const drawTrails = (project) => {
      if (!shows("trails")) return;
      pen.lineWidth = 1;
      pen.strokeStyle = "rgba(214,223,236,0.38)";
      const begin = Math.max(0, state.row - TRAIL);
      for (let p = 0; p < points; p++) {
        pen.beginPath();
        let open = false;
        for (let s = begin; s <= state.row; s++) {
          const xyz = at(s, p);
          if (xyz === null) { open = false; continue; }
          const [x, y] = project(xyz);
          if (open) pen.lineTo(x, y); else pen.moveTo(x, y);
          open = true;
        }
        pen.stroke();
      }
    };

    let drawn = [];
    const drawPoints = (project) => {
      drawn = [];
      for (let p = 0; p < points; p++) {
        const here = at(state.row, p);
        if (here === null) continue;
        const then = at(reference, p);
        const way = still ? data.values[p] : then === null ? null : Math.hypot(here[0] - then[0], here[1] - then[1], here[2] - then[2]);
        const [x, y, depth] = project(here);
        drawn.push({ p, x, y, depth, way, then });
      }
      drawn.sort((a, b) => b.depth - a.depth);
      for (const dot of drawn) {
        const share = dot.way === null ? 0 : dot.way / data.largest;
        const colour = dot.way === null ? "#8792a5" : RAMP[Math.round(Math.min(1, share) * (STEPS - 1))];
        if (shows("rays") && dot.then !== null) {
          const [x, y] = project(dot.then);
          pen.strokeStyle = colour;
          pen.globalAlpha = 0.8;
          pen.lineWidth = 1.4;
          pen.beginPath();
          pen.moveTo(x, y);
          pen.lineTo(dot.x, dot.y);
          pen.stroke();
          pen.globalAlpha = 1;
        }
        pen.beginPath();
        pen.arc(dot.x, dot.y, dot.p === state.hover ? 6 : still ? data.radius : 4, 0, 2 * Math.PI);
        pen.fillStyle = colour;
        pen.fill();
        if (still) continue;
        pen.lineWidth = 0.9;
        pen.strokeStyle = "#dfe6ee";
        pen.stroke();
      }
    };

    const text = (content, x, y, align) => {
      pen.textAlign = align;
      pen.strokeStyle = "#11151c";
      pen.lineWidth = 3;
      pen.strokeText(content, x, y);
      pen.fillText(content, x, y);
    };

    const drawNames = () => {
      pen.fillStyle = "#e6ebf2";
      const written = []; // a number that would stand on another is left out
      for (const dot of drawn.slice().reverse()) {
        if (dot.p !== state.hover && shows("ids") && !written.some(([x, y]) => Math.abs(x - dot.x) < 18 && Math.abs(y - dot.y) < 9)) {
          written.push([dot.x, dot.y]);
          text(String(data.ids[dot.p]), dot.x + 7, dot.y + 4, "left");
        }
      }
      const dot = drawn.find((one) => one.p === state.hover);
      if (dot === undefined) return;
      const way = dot.way === null ? "" : still ? (data.unit ? `, ${dot.way} ${data.unit}` : "") : `, ${(dot.way / 100).toFixed(2)} mm`;
      const words = `${still ? "" : "point "}${data.ids[dot.p]}${way}`, wide = pen.measureText(words).width + 12;
      const x = dot.x + 10 + wide > state.width ? dot.x - 10 - wide : dot.x + 10, y = dot.y - 28;
      pen.fillStyle = "#2a3340";
      pen.fillRect(x, y, wide, 21);
      pen.fillStyle = "#fff";
      pen.textAlign = "left";
      pen.fillText(words, x + 6, y + 15);
    };

    const drawLegend = (scale) => {
      const left = 16, top = state.height - 34, width = 180;
      RAMP.forEach((colour, i) => {
        pen.fillStyle = colour;
        pen.fillRect(left + (i * width) / STEPS, top, width / STEPS + 0.6, 8);
      });
      pen.fillStyle = "#e6ebf2";
      text("0", left, top + 23, "left");
      text(still ? `${data.largest}` : `${(data.largest / 100).toFixed(1)} mm`, left + width, top + 23, "right");
      text(still ? data.legend : `displacement since stage ${data.stages[reference]}`, left, top - 7, "left");
      let length = 10 ** Math.floor(Math.log10(state.width / 5 / scale));
      const wanted = state.width / 5 / scale;
      length *= wanted >= 5 * length ? 5 : wanted >= 2 * length ? 2 : 1;
      const right = state.width - 16;
      pen.strokeStyle = "#e6ebf2";
      pen.lineWidth = 1.2;
      pen.beginPath();
      pen.moveTo(right - length * scale, top + 4);
      pen.lineTo(right - length * scale, top + 8);
      pen.lineTo(right, top + 8);
      pen.lineTo(right, top + 4);
      pen.stroke();
      text(`${length / 100} mm`, right, top + 23, "right");
    };

    const draw = () => {
      const ratio = window.devicePixelRatio || 1;
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.fillStyle = "#11151c";
      pen.fillRect(0, 0, state.width, state.height);
      pen.font = "12px system-ui, 'Segoe UI', Roboto, Arial, sans-serif";
      const { project, scale } = projector();
      drawGround(project);
      drawOutline(project);
      drawCameras(project);
      drawTrails(project);
      drawPoints(project);
      drawNames();
      drawLegend(scale);
      if (still) return;
      const time = data.times[state.row];
      readout.textContent = `stage ${data.stages[state.row]}` + (time === null ? "" : `, ${time.toFixed(1)} ms`);
    };
    let asked = false;
    const redraw = () => {
      if (asked) return;
      asked = true;
      requestAnimationFrame(() => { asked = false; draw(); });
    };

    const show = (row) => { state.row = row; slider.value = String(row); redraw(); };
    const step = (now) => {
      if (!state.playing) return;
      const row = state.from + Math.floor(((now - state.began) / 1000) * data.per_second);
      show(row % stages);
      requestAnimationFrame(step);
    };
    const play = (on) => {
      state.playing = on;
      playButton.textContent = on ? "Pause" : "Play";
      state.began = performance.now();
      state.from = state.row >= stages - 1 ? 0 : state.row;
      if (on) requestAnimationFrame(step);
    };

    const resize = () => {
      const ratio = window.devicePixelRatio || 1;
      state.width = canvas.clientWidth;
      state.height = canvas.clientHeight;
      canvas.width = Math.round(state.width * ratio);
      canvas.height = Math.round(state.height * ratio);
      draw();
    };

    let grip = null;
    canvas.addEventListener("pointerdown", (event) => {
      grip = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointerup", () => { grip = null; });
    canvas.addEventListener("pointermove", (event) => {
      if (grip !== null) {
        const dx = event.clientX - grip[0], dy = event.clientY - grip[1];
        grip = [event.clientX, event.clientY];
        if (event.shiftKey) state.pan = [state.pan[0] + dx, state.pan[1] + dy];
        else {
          state.turn += dx * 0.008;
          state.tilt = Math.min(Math.max(state.tilt + dy * 0.008, -Math.PI / 2), Math.PI / 2);
        }
      } else {
        let best = 12;
        state.hover = -1;
        for (const dot of drawn) {
          const distance = Math.hypot(dot.x - event.offsetX, dot.y - event.offsetY);
          if (distance < best) { best = distance; state.hover = dot.p; }
        }
      }
      redraw();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      state.zoom = Math.min(Math.max(state.zoom * Math.exp(-event.deltaY * 0.0012), 0.2), 40);
      redraw();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (by === undefined || still) return;
      event.preventDefault();
      show(Math.min(Math.max(state.row + by, 0), stages - 1));
    });
    if (!still) {
      slider.addEventListener("input", () => { play(false); show(Number(slider.value)); });
      playButton.addEventListener("click", () => play(!state.playing));
    }
    for (const box of root.querySelectorAll("input[type='checkbox']")) {
      box.addEventListener("change", () => {
        held = shows("cameras") ? far : near;
        redraw();
      });
    }
    for (const button of root.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => {
        [state.turn, state.tilt] = VIEWS[button.dataset.view];
        state.zoom = 1;
        state.pan = [0, 0];
        redraw();
      });
    }
    window.addEventListener("resize", resize);
    resize();
  };
  document.querySelectorAll(".space-view").forEach(start);
})();

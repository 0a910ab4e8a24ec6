// Pictures that can be zoomed: uPlot draws, over the SVG of each picture, the curves in the JSON
// beside it. Panels over one horizontal axis show the same part of it.
(() => {
  "use strict";
  const INK = "#333", GRID = "#e4e4e4", GREY = "#8c8c8c", LEFT = 52, RIGHT = 20, FOOT = 46, NARROW = 700;
  const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif';
  const CURVES = new Set(["line", "dashes"]);
  const GROUPS = [];

  // A column of 32-bit floats; null is a gap.
  const floats = (base64) => {
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    return Array.from(new Float32Array(bytes.buffer), (v) => (Number.isFinite(v) ? v : null));
  };

  const number = (v, digits = 6) => {
    if (v == null) return "–";
    const rounded = Number(v.toPrecision(digits)), size = Math.abs(rounded);
    const plain = size === 0 || (size >= 1e-4 && size < 1e7);
    return (plain ? String(rounded) : rounded.toExponential()).replace("-", "−");
  };

  const make = (tag, name, parent, text) => {
    const element = document.createElement(tag);
    if (name) element.className = name;
    if (text) element.textContent = text;
    parent.append(element);
    return element;
  };

  // The outline of a mark around a point, of a size in pixels of the canvas.
  const OUTLINES = {
    dots: (p, x, y, r) => { p.moveTo(x + r, y); p.arc(x, y, r, 0, 2 * Math.PI); },
    squares: (p, x, y, r) => p.rect(x - r, y - r, 2 * r, 2 * r),
    triangles: (p, x, y, r) => polygon(p, [[x, y - r], [x + 0.87 * r, y + r / 2], [x - 0.87 * r, y + r / 2]]),
    diamonds: (p, x, y, r) => polygon(p, [[x, y - r], [x + r, y], [x, y + r], [x - r, y]]),
    crosses: (p, x, y, r) => {
      p.moveTo(x - r, y - r); p.lineTo(x + r, y + r); p.moveTo(x - r, y + r); p.lineTo(x + r, y - r);
    },
  };
  OUTLINES.rings = OUTLINES.dots;
  const polygon = (path, corners) => {
    corners.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
    path.closePath();
  };

  const marks = ({ shape, size }) => (u, place, from, to) => {
    const path = new Path2D(), outline = OUTLINES[shape], [xs, ys] = [u.data[0], u.data[place]];
    for (let i = from; i <= to; i++) {
      if (ys[i] == null) continue;
      const [x, y] = [u.valToPos(xs[i], "x", true), u.valToPos(ys[i], "y", true)];
      outline(path, x, y, size * uPlot.pxRatio);
    }
    const open = shape === "rings" || shape === "crosses";
    return open ? { stroke: path, fill: null, flags: 3 } : { stroke: null, fill: path, flags: 3 };
  };

  const series = (of) => {
    const common = {
      label: of.name, scale: "y", alpha: of.opacity, stroke: of.color, spanGaps: false,
      value: (u, v) => number(v), form: { held: of.held, mark: !CURVES.has(of.shape) },
    };
    if (!CURVES.has(of.shape)) {
      const width = of.shape === "rings" ? 1.6 : of.shape === "crosses" ? 1.8 : 0;
      const points = { show: true, size: 2 * of.size, width, stroke: of.color, fill: of.color };
      return { ...common, width: 0, paths: () => null, points: { ...points, paths: marks(of) } };
    }
    const paths = of.held ? uPlot.paths.stepped({ align: of.held }) : uPlot.paths.linear();
    const dash = of.shape === "dashes" ? [6, 4] : undefined;
    return { ...common, width: of.size, dash, paths, points: { show: false } };
  };

  // What is drawn besides the curves.
  const under = (panel, events) => (u) => {
    const { ctx } = u, { left, top, width, height } = u.bbox, ratio = uPlot.pxRatio;
    const across = (x) => u.valToPos(x, "x", true), upwards = (y) => u.valToPos(y, "y", true);
    const line = (points, color, size, dash, opacity = 1) => {
      ctx.beginPath();
      points.forEach(([x, y], i) => (i ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
      ctx.strokeStyle = color;
      ctx.globalAlpha = opacity;
      ctx.lineWidth = size * ratio;
      ctx.setLineDash(dash ? [6 * ratio, 4 * ratio] : []);
      ctx.stroke();
    };
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    for (const y of panel.limits) line([[left, upwards(y)], [left + width, upwards(y)]], GREY, 1);
    for (const x of panel.uprights) line([[across(x), top], [across(x), top + height]], GREY, 1, true);
    for (const of of events) {
      const x = across(of.x);
      line([[x, top], [x, top + height]], of.color, of.size, of.shape === "dashes", of.opacity);
    }
    for (const { x, y: [from, to], color } of panel.spans) {
      const at = across(x), cap = 4 * ratio;
      line([[at, upwards(from)], [at, upwards(to)]], color, 1.4);
      for (const y of [from, to]) line([[at - cap, upwards(y)], [at + cap, upwards(y)]], color, 1.4);
    }
    for (const of of panel.paths) {
      const points = of.points.map(([x, y]) => [across(x), upwards(y)]);
      line(points, of.color, of.size, of.shape === "dashes", of.opacity);
    }
    ctx.restore();
  };

  // Words beside points and at the tops of events, where they do not cover one another.
  const words = (panel, events, first) => (u) => {
    const { ctx } = u, { left, top, width, height } = u.bbox, ratio = uPlot.pxRatio, taken = [];
    ctx.save();
    ctx.font = FONT.replace("12px", `${12 * ratio}px`);
    ctx.textBaseline = "middle";
    ctx.textAlign = "left";
    // Whether the word found room.
    const write = (text, x, y, color, curves = []) => {
      if (x < left || x > left + width || y < top || y > top + height) return false;
      const long = ctx.measureText(text).width, room = 7 * ratio;
      const from = x + room + long > left + width ? x - room - long : x + room;
      const box = [from, y - room, from + long, y + room];
      const free = (b) => box[2] < b[0] || b[2] < box[0] || box[3] < b[1] || b[3] < box[1];
      if (!taken.every(free) || curves.some((at) => box[1] < at && at < box[3])) return false;
      taken.push(box);
      ctx.lineWidth = 3 * ratio;
      ctx.strokeStyle = "#fff";
      ctx.strokeText(text, from, y);
      ctx.fillStyle = color;
      ctx.fillText(text, from, y);
      return true;
    };
    for (const of of first ? events : []) write(of.label, u.valToPos(of.x, "x", true), top + 9 * ratio, INK);
    // Above its curve or below it, and on no other curve if there is such a place.
    const heights = panel.labels.map(({ at: [, y] }) => u.valToPos(y, "y", true));
    panel.labels.forEach(({ at: [x], text, color }, i) => {
      const others = heights.filter((_, k) => k !== i), across = u.valToPos(x, "x", true);
      const places = [others, []].flatMap((curves) => [-8, 8].map((away) => [away * ratio, curves]));
      places.some(([away, curves]) => write(text, across, heights[i] + away, color, curves));
    });
    ctx.restore();
  };

  // Where the cursor is.
  const place_of = (u) => number(u.cursor?.left >= 0 ? u.posToVal(u.cursor.left, "x") : null, 5);

  // Round values between two others, about as many as there is room for.
  const round = (low, high, room) => {
    const rough = (high - low) / Math.max(2, room), power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((digit) => digit * power >= rough);
    const first = Math.ceil(low / step), count = Math.floor(high / step) - first + 1;
    return Array.from({ length: Math.max(0, count) }, (_, i) => (first + i) * step);
  };

  // Numbers with as many digits as tell them apart and place them within a hundredth of a step.
  const apart = (values) => {
    const step = Math.min(...values.slice(1).map((v, i) => Math.abs(v - values[i])));
    const exact = (digits) => values.every((v) => Math.abs(Number(v.toPrecision(digits)) - v) < 0.01 * step);
    let digits = 6;
    while (digits < 15 && !exact(digits)) digits++;
    return values.map((v) => number(v, digits));
  };

  // The ticks of a logarithmic axis, all but decades or 1, 2 and 5 without words; round values where
  // less than a factor of two is seen.
  const decades = (u, low, high, side) => {
    const room = (side ? u.bbox.height / 28 : u.bbox.width / 70) / uPlot.pxRatio;
    if (high < 2 * low) {
      const values = round(low, high, room);
      return values.map((v, i) => [v, apart(values)[i]]);
    }
    const [from, to] = [low, high].map((v) => Math.log10(v)), length = to - from;
    const every = Math.max(1, Math.ceil(length / room)), fine = 3 * length <= room && length < 3;
    const ticks = [];
    for (let power = Math.floor(from); power <= to; power++) {
      for (let digit = 1; digit <= (length < 10 ? 9 : 1); digit++) {
        const at = digit * 10 ** power;
        const said = digit === 1 ? power % every === 0 : fine && (digit === 2 || digit === 5);
        if (at >= low && at <= high) ticks.push([at, said ? number(at) : ""]);
      }
    }
    return ticks;
  };

  const width_of = (u, text) => {
    u.ctx.font = FONT.replace("12px", `${12 * uPlot.pxRatio}px`);
    return u.ctx.measureText(text).width / uPlot.pxRatio;
  };

  // The words of a horizontal axis without those that would run into the one before.
  const spaced = (u, splits, words) => {
    let end = -Infinity;
    return words.map((word, i) => {
      const middle = u.valToPos(splits[i], "x"), half = 0.5 * width_of(u, word);
      if (!word || middle - half < end) return "";
      end = middle + half + 6;
      return word;
    });
  };

  // The panels of a column are in line: each leaves as much room as the longest word beside any.
  const room = (column) => (u, words) => {
    const needed = Math.ceil(Math.max(0, ...(words ?? []).map((word) => width_of(u, word)))) + 12;
    if (needed > column.left) {
      column.left = needed;
      queueMicrotask(() => column.plots.forEach((plot) => plot.redraw(false, true)));
    }
    return column.left;
  };

  const axis = (of, side, shown, column) => {
    const ticks_of = of.marks.length > 0 ? () => of.marks
      : of.log && ((u) => decades(u, u.scales[side ? "y" : "x"].min, u.scales[side ? "y" : "x"].max, side));
    const said = ticks_of ? (u) => ticks_of(u).map((tick) => tick[1]) : (u, splits) => apart(splits);
    const own = ticks_of && {
      splits: (u) => ticks_of(u).map((tick) => tick[0]),
      filter: (u, splits) => splits,
    };
    const values = (u, splits) => {
      if (!shown) return splits.map(() => "");
      return side ? said(u, splits) : spaced(u, splits, said(u, splits));
    };
    const grid = { stroke: GRID, width: 1 }, ticks = { stroke: GRID, width: 1, size: 5 };
    // The label of a vertical axis is in the panel's head, where it runs into nothing.
    const place = side ? { size: room(column), space: 28 } : {
      size: shown ? FOOT - 22 : 0, space: 70, ...(shown ? { label: of.label, labelSize: 22 } : {}),
    };
    return {
      scale: side ? "y" : "x", stroke: INK, font: FONT, labelFont: FONT, grid, ticks, values,
      ...place, ...own,
    };
  };

  // The least and the greatest value of what is seen of a panel's curves, cut at its sides.
  const extremes = (u, positive, [from, to]) => {
    let [low, high] = [Infinity, -Infinity];
    const take = (v) => {
      if (v == null || !Number.isFinite(v) || (positive && v <= 0)) return;
      [low, high] = [Math.min(low, v), Math.max(high, v)];
    };
    const xs = u.data[0];
    u.data.slice(1).forEach((ys, k) => {
      const { show, form } = u.series[k + 1];
      if (!show || !form) return;
      let before = -1;
      for (let i = 0; i < xs.length; i++) {
        if (ys[i] === undefined) continue;
        if (xs[i] >= from && xs[i] <= to) take(ys[i]);
        for (const side of [from, to]) {
          if (before < 0 || form.mark || xs[before] > side || xs[i] < side) continue;
          const [a, b] = [ys[before], ys[i]];
          if (a == null || b == null || xs[i] === xs[before]) continue;
          const share = form.held ? (form.held > 0 ? 0 : 1) : (side - xs[before]) / (xs[i] - xs[before]);
          take(positive ? a ** (1 - share) * b ** share : a + share * (b - a));
        }
        before = i;
        if (xs[i] > to) break;
      }
    });
    return [low, high];
  };

  // The vertical range: all of the picture's if all of it is seen, else what the part needs.
  const vertical = ({ y }, group) => (u) => {
    const [low, high] = group.whole() ? [] : extremes(u, y.log, group.now);
    if (!(low <= high)) return y.range;
    if (y.log) {
      const most = Math.log10(high), least = Math.max(Math.log10(low), most - 14);
      const room = Math.max(0.1, 0.04 * (most - least));
      return [10 ** (least - room), 10 ** (most + room)];
    }
    if (y.count) return [0, 1.08 * Math.max(1, high)];
    const room = 0.04 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - room, high + room];
  };

  // Where the value of a curve under the cursor is: of steps the one that holds, else the nearest.
  const at = (u, place, hovered, x) => {
    const ys = u.data[place], xs = u.data[0];
    if (place === 0) return hovered;
    let before = hovered, after = hovered;
    while (before >= 0 && (ys[before] == null || xs[before] > x)) before--;
    while (after < xs.length && (ys[after] == null || xs[after] < x)) after++;
    if (before < 0 || after >= xs.length) return before >= 0 ? before : after < xs.length ? after : null;
    const { held } = u.series[place].form;
    if (held) return held > 0 ? before : after;
    return x - xs[before] <= xs[after] - x ? before : after;
  };

  // Panels that are zoomed together: those over one horizontal axis.
  class Group {
    constructor(x) {
      this.log = x.log;
      this.full = x.range;
      this.now = x.range;
      this.plots = [];
      this.key = uPlot.sync(`group ${GROUPS.push(this)}`).key;
    }
    whole() { return this.now[0] <= this.full[0] && this.now[1] >= this.full[1]; }
    show(min, max) {
      if (!(max > min) || (min === this.now[0] && max === this.now[1])) return;
      this.now = [min, max];
      for (const plot of this.plots) plot.batch(() => plot.setScale("x", { min, max }));
    }
    all() {
      this.now = [NaN, NaN];
      this.show(...this.full);
    }
    // Moves by a share of what is seen and enlarges it around a place, both in shares of it.
    change(shift, factor, around = 0.5) {
      const [to, from] = this.log ? [Math.log10, (v) => 10 ** v] : [(v) => v, (v) => v];
      const [full, now] = [this.full.map(to), this.now.map(to)];
      const length = Math.min((now[1] - now[0]) * factor, full[1] - full[0]);
      let start = now[0] + around * (now[1] - now[0] - length) + shift * length;
      start = Math.min(Math.max(start, full[0]), full[1] - length);
      this.show(from(start), from(start + length));
    }
  }

  // Dragging with Shift moves; turning the wheel with Ctrl enlarges.
  const gestures = (u, group) => {
    u.over.addEventListener("mousedown", (down) => {
      if (!down.shiftKey) return;
      down.preventDefault();
      let last = down.clientX;
      const move = (event) => {
        group.change((last - event.clientX) / u.over.clientWidth, 1);
        last = event.clientX;
      };
      const up = () => {
        document.removeEventListener("mousemove", move);
        document.removeEventListener("mouseup", up);
      };
      document.addEventListener("mousemove", move);
      document.addEventListener("mouseup", up);
    });
    u.over.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      const { left, width } = u.over.getBoundingClientRect();
      group.change(0, event.deltaY < 0 ? 0.8 : 1.25, (event.clientX - left) / width);
    }, { passive: false });
  };

  // A series without a name belongs to the one beside it that has its color.
  const owners = (all) => all.map((of, i) => {
    if (of.name) return i;
    const near = [i - 1, i + 1].find((k) => all[k]?.name && all[k].color === of.color);
    return near ?? all.findIndex((other) => other.name && other.color === of.color);
  });

  // With the keyboard: a focused panel moves, enlarges and shows all, a focused name hides its curve.
  const keys = (u, head, group, panel) => {
    const frame = u.root;
    frame.tabIndex = 0;
    frame.setAttribute("role", "img");
    frame.setAttribute("aria-label", `${[panel.title, panel.y.label].filter(Boolean).join(", ")} over `
      + `${panel.x.label}. Arrow keys move, plus and minus zoom, 0 shows all.`);
    const acts = {
      ArrowLeft: () => group.change(-0.25, 1), ArrowRight: () => group.change(0.25, 1),
      "+": () => group.change(0, 0.5), "-": () => group.change(0, 2), 0: () => group.all(),
    };
    frame.addEventListener("keydown", (event) => {
      const act = event.ctrlKey || event.metaKey || event.altKey ? undefined : acts[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });
    head.querySelector(".u-legend").setAttribute("role", "presentation");
    head.querySelectorAll(".u-series").forEach((row, i) => {
      const name = row.querySelector("th");
      if (!i || !name) return;
      row.title = "Hide or show this curve";
      name.tabIndex = 0;
      name.setAttribute("role", "button");
      name.setAttribute("aria-pressed", "true");
      name.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        name.click();
      });
    });
  };

  const plot = (panel, { xs, events, first, foot, beside, column }, group, place) => {
    const head = make("div", "head", place);
    const label = panel.y.range && beside ? panel.y.label : "";
    // A title that names the variables needs their unit only.
    const [name] = label.split(" ("), said = name && panel.title.endsWith(name);
    if (panel.title) make("b", "", head, said ? panel.title + label.slice(name.length) : panel.title);
    if (label && !said) make("span", "axis", head, label);
    if (!panel.y.range) {
      make("div", "note", place, panel.note);
      return;
    }
    const owner = owners(panel.series);
    const tables = panel.series.map((of) => [xs[of.x], floats(of.y)]);
    // A gap reaches to the curve's own points, over places that only other curves have.
    const expand = tables.map((table) => table.map(() => 2));
    const data = tables.length ? uPlot.join(tables, expand) : [panel.x.range, [null, null]];
    const all = panel.series.length ? panel.series.map(series) : [{ show: false }];
    const spare = () => place.clientWidth || 960, rows = [];
    const options = {
      width: spare(), height: panel.height + (foot ? FOOT : 14), pxAlign: 0,
      padding: [8, RIGHT, 0, 0],
      scales: {
        x: { time: false, distr: panel.x.log ? 3 : 1, range: (u, min, max) => [min, max] },
        y: { distr: panel.y.log ? 3 : 1, range: vertical(panel, group) },
      },
      series: [{ label: panel.x.label, value: place_of }, ...all],
      axes: [axis(panel.x, 0, foot, column), axis(panel.y, 1, beside, column)],
      legend: {
        mount: (u, legend) => head.append(legend),
        markers: {
          width: (u, i) => (CURVES.has(panel.series[i - 1]?.shape) ? 2 : 1),
          dash: (u, i) => (panel.series[i - 1]?.shape === "dashes" ? "dashed" : "solid"),
          fill: (u, i) => {
            const of = panel.series[i - 1];
            return of && !CURVES.has(of.shape) && OUTLINES[of.shape] !== OUTLINES.crosses
              && of.shape !== "rings" ? of.color : "transparent";
          },
        },
      },
      cursor: {
        y: false, dataIdx: at, points: { size: 6 },
        drag: { x: true, y: true, uni: 24, dist: 4, setScale: false },
        sync: {
          key: group.key, setSeries: false,
          filters: { pub: (type) => type === "mousemove" || type === "mouseleave" },
        },
        bind: {
          dblclick: () => () => group.all(),
          mousedown: (u, target, handler) => (event) => { if (!event.shiftKey) handler(event); },
        },
      },
      hooks: {
        drawAxes: [under(panel, events)],
        draw: [words(panel, events, first)],
        setSelect: [(u) => {
          const { left, top, width, height } = u.select;
          const [low, high] = [top + height, top].map((pixel) => u.posToVal(pixel, "y"));
          const flat = height >= u.over.clientHeight;
          if (width > 0) group.show(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
          if (height > 0 && !flat) u.setScale("y", { min: low, max: high });
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
        setSeries: [(u, i, of) => {
          if (i == null || of.show == null) return;
          const name = rows[i]?.querySelector("th");
          name?.setAttribute("aria-pressed", of.show);
          owner.forEach((k, other) => {
            if (k === i - 1 && other !== k && u.series[other + 1].show !== of.show) {
              u.setSeries(other + 1, { show: of.show });
            }
          });
        }],
      },
    };
    const u = new uPlot(options, data, make("div", "", place));
    rows.push(...head.querySelectorAll(".u-series"));
    panel.series.forEach((of, i) => {
      if (!of.name) rows[i + 1].classList.add("nameless");
    });
    column.plots.push(u);
    keys(u, head, group, panel);
    panel.legend.forEach((i) => rows[i + 1].parentNode.append(rows[i + 1]));
    u.setScale("x", { min: group.now[0], max: group.now[1] });
    group.plots.push(u);
    gestures(u, group);
    new ResizeObserver(() => {
      const width = spare();
      if (width !== u.width) u.setSize({ width, height: u.height });
    }).observe(place);
  };

  const tools = (root, groups) => {
    const bar = make("div", "tools", root);
    const button = (text, title, act) => {
      const element = make("button", "", bar, text);
      Object.assign(element, { type: "button", title });
      element.setAttribute("aria-label", title);
      element.addEventListener("click", () => groups().forEach(act));
    };
    button("+", "Zoom in", (group) => group.change(0, 0.5));
    button("−", "Zoom out", (group) => group.change(0, 2));
    button("◀", "Move left", (group) => group.change(-0.25, 1));
    button("▶", "Move right", (group) => group.change(0.25, 1));
    button("All", "Show all", (group) => group.all());
    // Said once a page.
    if (waiting.help) return;
    waiting.help = true;
    make("span", "", bar, "Drag to zoom, with Shift to move; Ctrl and wheel zoom; a double click shows "
      + "all; a click on a name hides its curve. Keys in a panel: arrows, +, −, 0.");
  };

  const build = (figure) => {
    const spec = JSON.parse(figure.querySelector("script").textContent);
    const xs = spec.xs.map(floats);
    const root = make("div", "zoom", figure);
    figure.querySelector("svg").after(root);
    const groups = [];
    root.groups = groups; // for other scripts
    tools(root, () => groups);
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", spec.name);
    const narrow = figure.clientWidth < NARROW, columns = narrow ? 1 : spec.columns.length;
    const grid = make("div", "grid", root);
    grid.style.gridTemplateColumns = spec.columns.slice(0, columns).map((share) => `${share}fr`).join(" ");
    const in_line = spec.columns.map(() => ({ left: LEFT, plots: [] }));
    figure.classList.add("live");
    let shared = null;
    // Below it there are only notes, which have no axes.
    const last = Math.floor(spec.panels.findLastIndex((panel) => panel.y.range) / columns);
    spec.panels.forEach((panel, i) => {
      let group = panel.together ? shared : null;
      if (!group && panel.x.range) {
        groups.push((group = new Group(panel.x)));
        if (panel.together) shared = group;
      }
      const events = panel.together && i % columns === 0 ? spec.events : [];
      const foot = Math.floor(i / columns) === last || !panel.together;
      const beside = !panel.y.silent || columns < spec.columns.length, column = in_line[i % columns];
      plot(panel, { xs, events, first: i === 0, foot, beside, column }, group, make("div", "", grid));
    });
  };

  // One picture after the other, so that the first is there at once.
  const waiting = [...document.querySelectorAll("figure")].filter((of) => of.querySelector("script"));
  const next = () => {
    const figure = waiting.shift();
    if (!figure) return;
    build(figure);
    setTimeout(next);
  };
  next();
})();

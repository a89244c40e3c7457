// Draws each figure from the JSON beside it. Panels of a figure, and figures of the same group, share cursor and zoom.
"use strict";
(() => {
  const root = document.documentElement;
  const PRINT_WIDTH = 690; // A4 less its margins, in CSS pixels
  const PRINT_GAP = 28;
  const figures = [];
  const groups = new Map();

  const colour = (name) => getComputedStyle(root).getPropertyValue("--" + name).trim();
  const minus = (text) => text.replaceAll("-", "−");

  // Labels of a linear axis: as many decimals as the distance between ticks needs, or powers where these would be many.
  const MOST_DECIMALS = 5;
  const linearTicks = (u, splits, axis, space, step) => {
    let decimals = 0;
    while (decimals < 12 && Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) > 1e-6 * step * 10 ** decimals) decimals += 1;
    const small = (v) => v.toExponential(Math.max(0, Math.floor(Math.log10(Math.abs(v)) + 1e-9) + decimals));
    const text = (v) => (decimals <= MOST_DECIMALS ? v.toFixed(decimals) : v === 0 ? "0" : small(v));
    return splits.map((v) => (v == null ? "" : minus(text(Math.abs(v) < step / 1e6 ? 0 : v))));
  };

  // Labels of a logarithmic axis: powers of ten, or plain numbers where fewer than two powers are in view.
  const isPower = (v) => v > 0 && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6;
  const fewPowers = (splits) => splits.filter(isPower).length < 2;
  const logGrid = (u, splits) => (fewPowers(splits) ? splits : splits.map((v) => (isPower(v) ? v : null)));
  const logTicks = (u, splits) => {
    const power = (v) => {
      const e = Math.round(Math.log10(v));
      if (e >= -2 && e <= 3) return String(10 ** e >= 1 ? 10 ** e : (10 ** e).toFixed(-e));
      return "10" + [...String(e)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[+c])).join("");
    };
    return splits.map((v) => (v == null ? "" : isPower(v) ? power(v) : fewPowers(splits) ? String(+v.toPrecision(2)) : ""));
  };

  const value = (u, v) => (v == null ? "" : minus(String(+v.toPrecision(4))));

  // A line, or steps, lifted where there is no value: nothing is drawn across a break, however narrow.
  const pen = (stepped) => (u, index, from, to) => {
    const stroke = new Path2D();
    const [x, y] = [u.data[0], u.data[index]];
    let held = null;
    for (let i = from; i <= to; i++) {
      if (y[i] == null) {
        held = null;
        continue;
      }
      const [left, top] = [u.valToPos(x[i], "x", true), u.valToPos(y[i], "y", true)];
      if (held == null) stroke.moveTo(left, top);
      else if (stepped) stroke.lineTo(left, held);
      stroke.lineTo(left, top);
      held = top;
    }
    return { stroke, fill: null, clip: null, flags: 1 };
  };
  const paths = { line: pen(false), step: pen(true), points: () => null };

  function series(s) {
    const ink = colour(s.role);
    const points = s.style === "points";
    const fill = s.role === "measured" ? ink + "66" : ink + "99";
    return {
      label: s.label, value, class: points ? "points" : undefined,
      stroke: points ? fill : ink, width: s.role === "command" ? 1 : s.line ? 2 : 1.4,
      paths: paths[s.style],
      points: points ? { show: true, size: 4, width: 0, fill } : { show: false },
    };
  }

  // Breaks between stretches: a dotted line, or a band where there is time between them.
  function borders(breaks) {
    return (u) => {
      const { ctx, bbox } = u;
      const inside = (x) => Math.min(Math.max(x, bbox.left), bbox.left + bbox.width);
      ctx.save();
      ctx.strokeStyle = colour("command");
      ctx.fillStyle = colour("band");
      ctx.lineWidth = devicePixelRatio;
      ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
      for (const [from, to] of breaks) {
        const [left, right] = [from, to].map((t) => u.valToPos(t, "x", true));
        if (right < bbox.left || left > bbox.left + bbox.width) continue;
        if (right - left > 4 * devicePixelRatio) {
          ctx.fillRect(inside(left), bbox.top, inside(right) - inside(left), bbox.height);
        } else {
          const x = Math.round((left + right) / 2) + 0.5;
          ctx.beginPath();
          ctx.moveTo(x, bbox.top);
          ctx.lineTo(x, bbox.top + bbox.height);
          ctx.stroke();
        }
      }
      ctx.restore();
    };
  }

  // A finger drawn sideways zooms as a mouse does; two quick taps reset.
  function touch(u) {
    let lastTap = 0;
    const send = (type, target, event) => {
      const at = event.changedTouches[0];
      target.dispatchEvent(new MouseEvent(type, { clientX: at.clientX, clientY: at.clientY, button: 0, movementX: 1, bubbles: true, view: window }));
    };
    u.over.addEventListener("touchstart", (event) => {
      if (event.touches.length > 1) return;
      send("mousemove", u.over, event);
      send("mousedown", u.over, event);
    }, { passive: true });
    u.over.addEventListener("touchmove", (event) => send("mousemove", u.over, event), { passive: true });
    u.over.addEventListener("touchend", (event) => {
      send("mouseup", document, event);
      if (event.timeStamp - lastTap < 350) send("dblclick", u.over, event);
      lastTap = event.timeStamp;
    }, { passive: true });
  }

  // A cloud gets room at its sides: points without values just beyond its ends.
  function widen(plot) {
    const x = plot.points;
    const room = 0.03 * (x.at(-1) - x[0]) || 1;
    plot.points = [x[0] - room, ...x, x.at(-1) + room];
    for (const panel of plot.panels) for (const s of panel.series) if (!s.line) s.values = [null, ...s.values, null];
  }

  // The range of what is in view, but not beyond the limits; a constant gets room on both sides, and what hardly changes some, or the
  // numbers at its axis would be longer than their place.
  const within = ([low, high]) => (u, min, max) => {
    if (min == null) return [null, null];
    const [from, to] = [Math.min(Math.max(min, low), high), Math.max(Math.min(max, high), low)];
    const size = Math.max(Math.abs(from), Math.abs(to));
    const room = from === to ? 0.1 * size || 1 : Math.max(0, 0.5 * (1e-3 * size - (to - from)));
    return uPlot.rangeNum(from - room, to + room, 0.1, true);
  };

  function build(figure, width, tall = 1) {
    const { plot, cloud, holder, key } = figure;
    const narrow = width < 480;
    const unit = (plot.x.label.match(/\[(.*)\]$/) || ["", ""])[1];
    const font = `${narrow ? 11 : 12}px system-ui, sans-serif`;
    figure.charts = plot.panels.map((panel, index) => {
      const last = index === plot.panels.length - 1;
      const axis = (spec) => ({
        stroke: colour("soft"), font, labelFont: font, labelGap: 2, label: spec.label,
        grid: { stroke: colour("rule"), width: 1, ...(spec.log && { filter: logGrid }) },
        ticks: { stroke: colour("rule"), width: 1, size: 5, ...(spec.log && { filter: logGrid }) },
        values: spec.log ? logTicks : linearTicks,
        ...(spec.log && { filter: (u, splits) => splits }),
      });
      const options = {
        width, height: tall * panel.height + (last ? 26 : 0),
        padding: [10, 10, 0, 0],
        scales: { x: { time: false, distr: plot.x.log ? 3 : 1 }, y: panel.y.log ? { distr: 3 } : { range: within(panel.limits || [-Infinity, Infinity]) } },
        axes: [
          { ...axis(plot.x), size: 30, labelSize: 20, space: narrow ? 45 : 60, ...(last ? {} : { label: null, size: 12, values: (u, s) => s.map(() => "") }) },
          { ...axis(panel.y), size: 66, labelSize: 18, space: panel.height < 180 ? 20 : 28 },
        ],
        series: [{ label: "at", value: (u, v) => (v == null ? "" : value(u, v) + " " + unit) }, ...panel.series.map(series)],
        cursor: {
          sync: { key, scales: ["x", null], setSeries: false }, points: { size: 6 },
          drag: cloud || plot.x.log ? { x: true, y: true, uni: 30 } : { x: true, y: false },
        },
        hooks: {
          drawClear: [borders(plot.breaks)],
          ready: [touch],
          setCursor: [(u) => holder.classList.toggle("live", u.cursor.idx != null)],
          setScale: [(u, scale) => scale === "x" && linked(key, u)],
        },
      };
      const columns = panel.series.map((s) => (s.line ? plot.points.map((x) => s.line[0] * x + s.line[1]) : s.values));
      const chart = new uPlot(options, [plot.points, ...columns], holder);
      return chart;
    });
  }

  // Carries a zoom along x to every chart of the group and shows the way back.
  let carrying = false;
  function linked(key, source) {
    if (carrying) return;
    carrying = true;
    const { min, max } = source.scales.x;
    for (const figure of groups.get(key)) {
      for (const chart of figure.charts) {
        if (chart !== source && (chart.scales.x.min !== min || chart.scales.x.max !== max)) chart.setScale("x", { min, max });
      }
      figure.button.hidden = min <= figure.plot.points[0] && max >= figure.plot.points.at(-1);
    }
    carrying = false;
  }

  function reset(key) {
    for (const figure of groups.get(key)) {
      for (const chart of figure.charts) chart.setData(chart.data, true);
      figure.button.hidden = true;
    }
  }

  function redraw(width, tall) {
    for (const figure of figures) {
      for (const chart of figure.charts) chart.destroy();
      figure.button.hidden = true;
      build(figure, width(figure), tall);
    }
  }

  for (const [index, element] of [...document.querySelectorAll("figure.plot")].entries()) {
    const plot = JSON.parse(element.querySelector("script").textContent);
    const holder = element.querySelector(".canvas");
    const cloud = plot.panels.some((p) => p.series.some((s) => s.style === "points"));
    if (cloud && plot.points.length) widen(plot);
    const key = plot.group || "figure-" + index;
    const button = document.createElement("button");
    button.className = "reset";
    button.type = "button";
    button.textContent = "Reset zoom";
    button.hidden = true;
    button.addEventListener("click", () => reset(key));
    holder.append(button);
    const figure = { plot, cloud, holder, key, button, element, charts: [] };
    figures.push(figure);
    groups.set(key, [...(groups.get(key) || []), figure]);
    build(figure, holder.clientWidth);
  }

  if (figures.length) {
    const hint = document.createElement("p");
    hint.className = "note hint";
    hint.textContent = "Drag across a plot to zoom in; double-click or double-tap to go back.";
    (figures[0].element.closest(".grid") || figures[0].element).before(hint);
  }

  let width = root.clientWidth;
  addEventListener("resize", () => {
    if (root.clientWidth === width) return;
    width = root.clientWidth;
    for (const figure of figures) for (const chart of figure.charts) chart.setSize({ width: figure.holder.clientWidth, height: chart.height });
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw((f) => f.holder.clientWidth));

  // Paper is white, as wide as it is, and holds two figures a page.
  addEventListener("beforeprint", () => {
    root.classList.add("print");
    redraw((f) => (f.element.parentElement.classList.contains("grid") ? (PRINT_WIDTH - PRINT_GAP) / 2 : PRINT_WIDTH), 0.75);
  });
  addEventListener("afterprint", () => {
    root.classList.remove("print");
    redraw((f) => f.holder.clientWidth);
  });
})();

// The plot of an episode: panels one below the other on one axis of time, and its player.

const signalHeight = 96;
const robustnessHeight = 150;
const titleRoom = 24;
const edges = { top: 26, bottom: 38 };

// Traces and a layout of one episode.
function episode(chart, c, width) {
  const times = reals(chart.times);
  const letters = Math.floor((width - 60) / 7);
  const panels = panelsOf(chart);
  const inner = panels.reduce((sum, panel) => sum + panel.height, 0);
  const layout = frame(c, {
    height: inner + edges.top + edges.bottom,
    margin: { l: 58, r: 14, t: edges.top, b: edges.bottom },
    hovermode: "x unified",
    hoversubplots: "axis",
    hoverdistance: -1,
    dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
    annotations: [],
    shapes: [],
    xaxis: axis(c, chart.unit === "s" ? "time (s)" : "step", {
      fixedrange: false,
      range: span(times),
      showspikes: true,
      spikemode: "across",
      spikesnap: "hovered data",
      spikecolor: c.muted,
      spikethickness: 1,
      spikedash: "dot",
      anchor: `y${panels.length > 1 ? panels.length : ""}`,
      hoverformat: ".5~g",
      unifiedhovertitle: { text: chart.unit === "s" ? "%{x} s" : "step %{x}" },
      automargin: false,
    }),
  });
  const traces = [];
  let above = 0;
  panels.forEach((panel, i) => {
    const suffix = i === 0 ? "" : String(i + 1);
    const top = 1 - (above + titleRoom) / inner;
    above += panel.height;
    layout[`yaxis${suffix}`] = axis(c, "", {
      domain: [1 - (above - 4) / inner, top],
      range: panel.range,
      nticks: 4,
      automargin: false,
    });
    layout.annotations.push(note(c, safe(cut(panel.title.length > letters ? panel.short ?? panel.title : panel.title, letters)), {
      xref: "paper", yref: "paper", x: 0, y: top, xanchor: "left", yanchor: "bottom", font: { size: 12, color: c.ink },
    }));
    if (panel.signed) {
      layout.shapes.push(line(c, { xref: "paper", yref: `y${suffix}`, x0: 0, x1: 1, y0: 0, y1: 0 }, { layer: "below" }));
    }
    traces.push(...panel.traces(c, times).map((trace) => ({ type: "scatter", mode: "lines", xaxis: "x", yaxis: `y${suffix}`, ...trace })));
  });
  const decided = timeOf(chart.decided_at);
  if (decided !== null) {
    const at = real(decided);
    const right = at > (times[0] + times.at(-1)) / 2;
    layout.shapes.push(line(c, { xref: "x", yref: "paper", x0: at, x1: at, y0: 0, y1: 1 }, { line: { color: c.violated, width: 1.5, dash: "dash" } }));
    layout.annotations.push(note(c, `✗ violated at ${showTime(at, chart.unit)}`, {
      xref: "x", yref: "paper", x: at, y: 1, yanchor: "bottom", xanchor: right ? "right" : "left", yshift: 4,
      font: { size: 12, color: c["violated-ink"] },
    }));
  }
  return { traces, layout };
}

// The seconds of a moment, or the number of its sample.
function timeOf(moment) {
  return moment === null ? null : moment.seconds ?? moment.sample;
}

function panelsOf(chart) {
  const panels = Object.entries(chart.signals).map(([name, values]) => signalPanel(name, reals(values), chart));
  if (chart.robustness.length) panels.push(robustnessPanel(chart));
  for (const [name, values] of Object.entries(chart.predicates)) {
    panels.push(predicatePanel(name, reals(values), chart));
  }
  return panels;
}

function span(values, least = 0) {
  const finite = values.filter(Number.isFinite);
  if (!finite.length) return [-1, 1];
  const low = Math.min(...finite);
  const high = Math.max(...finite);
  const pad = (high - low || Math.abs(high) || 1) * least;
  return [low - pad, high + pad];
}

function within(values, [low, high]) {
  return values.map((value) => (value === null ? null : Math.max(low, Math.min(high, value))));
}

function curve(name, times, values, colour, more = {}) {
  return {
    name: safe(cut(name, 50)),
    x: times,
    y: values,
    customdata: values.map(show),
    hovertemplate: "%{fullData.name}: %{customdata}<extra></extra>",
    line: { color: colour, width: 1.75 },
    ...more,
  };
}

function diamonds(c, points, verdict) {
  return {
    mode: "markers",
    name: "decides",
    x: points.map(([time]) => time),
    y: points.map(([, value]) => value),
    hoverinfo: "skip",
    marker: {
      symbol: "diamond",
      size: 11,
      color: verdict === "violated" ? c.violated : c.ink,
      line: { color: c.page, width: 1.5 },
    },
  };
}

function signalPanel(name, values, chart) {
  const points = chart.deciding
    .filter((each) => name in each.values)
    .map((each) => [each.time, real(each.values[name])]);
  return {
    title: name,
    height: signalHeight,
    range: span(values, 0.12),
    traces: (c, times) => [curve(name, times, values, c.signal), ...(points.length ? [diamonds(c, points, chart.verdict)] : [])],
  };
}

function robustnessPanel(chart) {
  const [robustness, lower, upper] = [chart.robustness, chart.lower, chart.upper].map(reals);
  const range = span([0, ...robustness, ...lower, ...upper], 0.12);
  const bounded = lower.length > 0 && upper.length > 0;
  return {
    title: bounded ? "robustness if it ended now, and what it can still become" : "robustness if it ended now",
    short: "robustness if it ended now",
    height: robustnessHeight,
    signed: true,
    range,
    traces: (c, times) => [
      ...(bounded
        ? [
          curve("at most", times, within(upper, range), c.bounds, { customdata: upper.map(show), line: { color: c.bounds, width: 1, shape: "hv" } }),
          curve("at least", times, within(lower, range), c.bounds, {
            customdata: lower.map(show), line: { color: c.bounds, width: 1, shape: "hv" }, fill: "tonexty", fillcolor: faded(c.bounds, 0.4),
          }),
        ]
        : []),
      curve("robustness", times, within(robustness, range), c.ink, { customdata: robustness.map(show), line: { color: c.ink, width: 2, shape: "hv" } }),
    ],
  };
}

function predicatePanel(name, values, chart) {
  const range = span([0, ...values], 0.12);
  const points = chart.deciding
    .filter((each) => each.predicate === name)
    .map((each) => [each.time, real(each.robustness)]);
  return {
    title: `margin of ${name}`,
    height: signalHeight,
    signed: true,
    range,
    traces: (c, times) => {
      const below = negativePart(times, within(values, range));
      return [
        {
          ...below,
          hoverinfo: "skip",
          line: { width: 0 },
          fill: "tozeroy",
          fillcolor: faded(c.undecided, 0.2),
          fillpattern: { shape: "/", fgcolor: c.undecided, size: 6, solidity: 0.25 },
        },
        curve(name, times, within(values, range), c.signal, { customdata: values.map(show) }),
        ...(points.length ? [diamonds(c, points, chart.verdict)] : []),
      ];
    },
  };
}

// The part of a curve below zero, with the points where it crosses.
function negativePart(times, values) {
  const x = [];
  const y = [];
  values.forEach((value, i) => {
    const before = values[i - 1];
    if (i > 0 && before * value < 0) {
      x.push(times[i - 1] + ((times[i] - times[i - 1]) * before) / (before - value));
      y.push(0);
    }
    x.push(times[i]);
    y.push(Math.min(value, 0));
  });
  return { x, y };
}

// The slider of time, what it reads, and the picture of that time.
function startPlayer(place, chart, plot) {
  const times = reals(chart.times);
  if (!times.length) return;
  const slider = make("input", { type: "range", min: 0, max: times.length - 1, step: 1, value: 0 });
  const output = make("output", { "aria-live": "off" });
  const reset = make("button", { type: "button" }, "Reset zoom");
  place.append(make("div", {}, make("div", { class: "tools" }, make("label", {}, "Time", slider), reset), output));
  const picture = chart.frames.length ? make("img", { alt: "" }) : null;
  if (picture) place.append(picture);
  const columns = columnsOf(chart);
  const go = (i) => {
    const parts = columns.map(([name, values]) => [cut(name, 60), show(values[i])]);
    slider.value = String(i);
    slider.setAttribute("aria-valuetext", [showTime(times[i], chart.unit), ...parts.map((part) => part.join(" "))].join(", "));
    const shownParts = parts.map(([name, value]) => make("span", {}, `${name} `, make("b", {}, value)));
    output.replaceChildren(make("b", {}, showTime(times[i], chart.unit)), ...shownParts);
    const shown = picture && (chart.frames.findLast((each) => each.time <= times[i]) ?? chart.frames[0]);
    if (shown && picture.alt !== shown.words) {
      picture.src = shown.source;
      picture.alt = shown.words;
    }
  };
  const nearest = (time) => times.reduce((best, each, i) => (Math.abs(each - time) < Math.abs(times[best] - time) ? i : best), 0);
  slider.addEventListener("input", () => {
    go(Number(slider.value));
    point(plot, times[Number(slider.value)]);
  });
  reset.addEventListener("click", () => Plotly.relayout(plot, { "xaxis.range": span(times) }));
  plot.on("plotly_hover", (event) => go(nearest(event.points[0].x)));
  go(nearest(real(timeOf(chart.decided_at)) ?? chart.deciding[0]?.time ?? times[0]));
}

// A line at the time of the slider.
function point(plot, time) {
  const shapes = (plot.layout.shapes ?? []).filter((shape) => shape.name !== "slider");
  const mark = { ...line(plot.colours, { xref: "x", yref: "paper", x0: time, x1: time, y0: 0, y1: 1 }), name: "slider" };
  mark.line = { color: plot.colours.link, width: 1.5 };
  Plotly.relayout(plot, { shapes: [...shapes, mark] });
}

function columnsOf(chart) {
  const series = { robustness: chart.robustness, "at least": chart.lower, "at most": chart.upper };
  return [
    ...Object.entries(chart.signals),
    ...Object.entries(series).filter(([, values]) => values.length),
    ...Object.entries(chart.predicates).map(([name, values]) => [`margin of ${name}`, values]),
  ].map(([name, values]) => [name, reals(values)]);
}

// The samples as a table, made when it is first opened.
function startSamples(details, chart) {
  details.addEventListener("toggle", () => {
    if (!details.open || details.querySelector("table")) return;
    const columns = [[chart.unit === "s" ? "time (s)" : "step", reals(chart.times)], ...columnsOf(chart)];
    const head = make("tr", {}, ...columns.map(([name]) => make("th", { scope: "col", class: "n" }, name)));
    const rows = chart.times.map((_, i) => make("tr", {}, ...columns.map(([, values]) => make("td", { class: "n" }, show(values[i])))));
    const table = make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows));
    details.append(make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Samples" }, table));
  });
}

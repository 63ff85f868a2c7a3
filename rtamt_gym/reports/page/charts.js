// All charts except the plots of episodes. Each function makes traces and a layout from its data.

const symbols = { satisfied: "circle", violated: "x", undecided: "diamond-open", failed: "cross-thin-open" };

function axis(c, title, more = {}) {
  return {
    title: { text: title, font: { size: 12, color: c.muted }, standoff: 8 },
    gridcolor: c.line,
    linecolor: c.line,
    zeroline: false,
    automargin: true,
    fixedrange: true,
    ...more,
  };
}

function frame(c, more = {}) {
  return {
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: c.ink },
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    margin: { l: 52, r: 12, t: 22, b: 44 },
    showlegend: false,
    dragmode: false,
    hovermode: "closest",
    hoverlabel: { bgcolor: c.raised, bordercolor: c.line, font: { color: c.ink }, align: "left", namelength: -1 },
    ...more,
  };
}

function line(c, where, more = {}) {
  return { type: "line", line: { color: c.ink, width: 1.5 }, ...where, ...more };
}

function zeroLine(c, along) {
  return along === "x"
    ? line(c, { xref: "x", yref: "paper", x0: 0, x1: 0, y0: 0, y1: 1 })
    : line(c, { xref: "paper", yref: "y", x0: 0, x1: 1, y0: 0, y1: 0 }, { layer: "below" });
}

function note(c, text, where) {
  return { text, showarrow: false, font: { size: 11, color: c.muted }, ...where };
}

// Of each verdict a pattern: what is undecided is neither of the others on paper and to any eye.
const patterns = { violated: "/", undecided: "|", satisfied: "", failed: "x" };

function histogram(chart, c) {
  const places = chart.counts.map((_, i) => chart.first + i);
  const words = Object.entries(chart.by_verdict);
  const says = chart.counts.map((count, i) => {
    const found = words.filter(([, counts]) => counts[i]).map(([word, counts]) => `${counts[i]} ${word}`);
    const text = found.length === 1 ? ` ${found[0].split(" ")[1]}` : `: ${found.join(", ")}`;
    return `${show(places[i] * chart.width)} to ${show((places[i] + 1) * chart.width)}: ${countOf(count, chart.noun)}${text}`;
  });
  const bars = ([word, counts]) => ({
    type: "bar",
    name: word,
    x: places.map((place) => (place + 0.5) * chart.width),
    y: counts,
    width: chart.width,
    customdata: says,
    hovertemplate: "%{customdata}<extra></extra>",
    marker: {
      color: c[word],
      line: { color: c.page, width: 1 },
      pattern: { shape: patterns[word], fillmode: "overlay", fgcolor: c.page, fgopacity: 0.8, size: 7, solidity: 0.25 },
    },
  });
  const low = Math.min(chart.first, 0) * chart.width;
  const high = Math.max(chart.first + chart.counts.length, 0) * chart.width;
  const pad = (high - low || 2) * 0.04;
  return {
    traces: words.map(bars),
    layout: frame(c, {
      barmode: "stack",
      margin: { l: 52, r: 12, t: 8, b: 44 },
      xaxis: axis(c, "robustness", { range: [low - pad, high + pad], showgrid: false }),
      yaxis: axis(c, `${chart.noun}s`, { rangemode: "tozero", tickformat: "d", nticks: 5, ...(Math.max(...chart.counts) < 5 && { dtick: 1 }) }),
      shapes: [zeroLine(c, "x")],
    }),
  };
}

function violations(chart, c) {
  const share = chart.times.map((_, i) => (i + 1) / chart.episodes);
  const last = chart.times.at(-1);
  const says = chart.times.map(
    (time, i) => `${countOf(i + 1, chart.noun)} of ${chart.episodes} by ${showTime(time, chart.unit)}`,
  );
  const steps = {
    type: "scatter",
    mode: "lines+markers",
    x: [0, ...chart.times],
    y: [0, ...share],
    customdata: ["none at the start", ...says],
    hovertemplate: "%{customdata}<extra></extra>",
    line: { shape: "hv", color: c.violated, width: 2 },
    marker: { symbol: "x", size: [0, ...chart.times.map(() => 7)], color: c.violated },
  };
  return {
    traces: [steps],
    layout: frame(c, {
      xaxis: axis(c, chart.unit === "s" ? "time (s)" : "step", { range: [0, last * 1.06 || 1], showgrid: false }),
      yaxis: axis(c, "violated so far", { tickformat: ".0%", range: [0, Math.min(1.04, share.at(-1) * 1.25)], nticks: 5 }),
    }),
  };
}

function timeline(chart, c, width) {
  const letters = Math.floor((width - 60) / 7);
  const stretches = (word) => {
    const found = chart.bodies.flatMap((body, i) => body.runs.filter((run) => run[2] === word).map((run) => [i, ...run]));
    return {
      type: "scatter",
      mode: "lines+markers",
      name: word,
      x: found.flatMap(([, start, end]) => [start, end, null]),
      y: found.flatMap(([i]) => [-i, -i, null]),
      customdata: found.flatMap(([, start, end, , worst]) => {
        const text = `${word}: ${showTime(start, chart.unit)} to ${showTime(end, chart.unit)}${worst && `, robustness ${worst}`}`;
        return [text, text, null];
      }),
      hovertemplate: "%{customdata}<extra></extra>",
      line: { color: c[word], width: 10, dash: word === "undecided" ? "dot" : "solid" },
      marker: { symbol: "line-ns-open", size: 12, color: c[word], line: { color: c[word], width: 2 } },
    };
  };
  const pad = (chart.span[1] - chart.span[0] || 1) * 0.02;
  return {
    traces: ["undecided", "violated"].filter((word) => chart.bodies.some((body) => body.runs.some((run) => run[2] === word))).map(stretches),
    layout: frame(c, {
      margin: { l: 12, r: 12, t: 12, b: 44 },
      xaxis: axis(c, chart.unit === "s" ? "time (s)" : "step", { range: [chart.span[0] - pad, chart.span[1] + pad], fixedrange: false }),
      yaxis: axis(c, "", { range: [0.4 - chart.bodies.length, 0.9], showticklabels: false, showgrid: false }),
      annotations: chart.bodies.map((body, i) => note(c, safe(cut(body.text, letters)), {
        xref: "paper", x: 0, y: -i + 0.45, xanchor: "left", yanchor: "middle",
      })),
    }),
  };
}

function convergence(chart, c) {
  const robustness = reals(chart.robustness);
  const says = robustness.map(
    (value, i) => `simulation ${chart.simulations[i]}: ${value === null ? "failed" : `${show(value)}, ${chart.verdicts[i]}`}`,
  );
  return {
    traces: [
      {
        type: "scatter",
        mode: "markers",
        x: chart.simulations,
        y: robustness,
        customdata: says,
        hovertemplate: "%{customdata}<extra></extra>",
        marker: {
          symbol: chart.verdicts.map((word) => symbols[word]),
          color: chart.verdicts.map((word) => c[word]),
          size: 7,
          opacity: 0.8,
        },
      },
      {
        type: "scatter",
        mode: "lines",
        x: chart.simulations,
        y: reals(chart.least),
        hoverinfo: "skip",
        line: { shape: "hv", color: c.ink, width: 2 },
      },
    ],
    layout: frame(c, {
      xaxis: axis(c, "simulation", { showgrid: false, tickformat: "d", ...(robustness.length < 8 && { dtick: 1 }) }),
      yaxis: axis(c, "robustness"),
      shapes: [zeroLine(c, "y")],
      annotations: [
        note(c, "line: the minimum so far", { xref: "paper", yref: "paper", x: 1, y: 1, xanchor: "right", yanchor: "bottom" }),
      ],
    }),
  };
}

function map(chart, c, width) {
  const cells = chart.cells.map(reals);
  const finite = cells.flat().filter((value) => Number.isFinite(value));
  const size = Math.max(...finite.map(Math.abs), 1e-12);
  const cell = (value) => (value === null ? null : Math.max(-size, Math.min(size, value)));
  const few = width / chart.xs.length > 44 && chart.ys.length <= 20;
  const marked = { violated: [], undecided: [] };
  chart.verdicts.forEach((row, j) => row.forEach((word, i) => marked[word]?.push([i, j])));
  const open = (i, j) => chart.verdicts[j][i] === "undecided";
  const said = cells.map((row, j) => row.map((value, i) => safe(
    `${cut(chart.x, 40)} = ${show(real(chart.xs[i]))}, ${cut(chart.y, 40)} = ${show(real(chart.ys[j]))}: ${value === null ? "failed" : `${show(value)}, ${chart.verdicts[j][i]}`}`,
  )));
  // Columns are numbered: a grid whose steps differ has cells of one size.
  const places = (numbers) => ({
    tickmode: "array",
    tickvals: numbers.map((_, i) => i).filter((i) => i % Math.ceil(numbers.length / 12) === 0),
    ticktext: numbers.map(show).filter((_, i) => i % Math.ceil(numbers.length / 12) === 0),
    showgrid: false,
  });
  return {
    traces: [
      {
        type: "heatmap",
        z: cells.map((row, j) => row.map((value, i) => (open(i, j) ? null : cell(value)))),
        zmin: -size,
        zmax: size,
        xgap: 1,
        ygap: 1,
        colorscale: [[0, c.violated], [0.5, c.page], [1, c.satisfied]],
        colorbar: { thickness: 10, outlinewidth: 0, len: 0.9, tickfont: { size: 11 } },
        text: cells.map((row) => row.map((value) => (few && value !== null ? show(Number(value.toPrecision(3))) : ""))),
        texttemplate: few ? "%{text}" : "",
        textfont: { color: c.ink },
        customdata: said,
        hovertemplate: "%{customdata}<extra></extra>",
        hoverongaps: true,
      },
      ...(marked.undecided.length ? [{
        type: "heatmap",
        z: cells.map((row, j) => row.map((_, i) => (open(i, j) ? 1 : null))),
        xgap: 1,
        ygap: 1,
        showscale: false,
        colorscale: [[0, faded(c.undecided, 0.45)], [1, faded(c.undecided, 0.45)]],
        text: cells.map((row) => row.map((value) => (few && value !== null ? show(Number(value.toPrecision(3))) : ""))),
        texttemplate: few ? "%{text}" : "",
        textfont: { color: c.ink },
        customdata: said,
        hovertemplate: "%{customdata}<extra></extra>",
        hoverongaps: false,
      }] : []),
      ...Object.entries({ violated: "x-thin", undecided: "diamond-open" }).map(([word, symbol]) => ({
        type: "scatter",
        mode: "markers",
        x: marked[word].map(([i]) => i),
        y: marked[word].map(([, j]) => j + (few ? 0.28 : 0)),
        hoverinfo: "skip",
        marker: { symbol, size: 7, color: c.ink, line: { width: 1.5, color: c.ink } },
      })),
    ],
    layout: frame(c, {
      xaxis: axis(c, safe(cut(chart.x, 60)), places(chart.xs)),
      yaxis: axis(c, safe(cut(chart.y, 30)), places(chart.ys)),
    }),
  };
}

function cases(chart, c, width) {
  const of = data.cases[chart.section];
  const robustness = reals(of.robustness[chart.requirement]);
  const verdicts = of.verdicts[chart.requirement];
  const columns = Object.entries(of.columns);
  const across = Math.max(1, Math.min(columns.length, Math.floor(width / 300)));
  const down = Math.ceil(columns.length / across);
  const layout = frame(c, {
    height: 230 * down,
    grid: { rows: down, columns: across, pattern: "independent", xgap: 0.12, ygap: 0.34 },
    shapes: [],
  });
  const finite = robustness.filter(Number.isFinite);
  const low = Math.min(0, ...finite);
  const high = Math.max(0, ...finite);
  const pad = (high - low || 1) * 0.08;
  const traces = columns.map(([name, values], i) => {
    const suffix = i === 0 ? "" : String(i + 1);
    layout[`xaxis${suffix}`] = axis(c, safe(cut(name, Math.floor(width / across / 8))), { showgrid: false });
    layout[`yaxis${suffix}`] = axis(c, i % across === 0 ? "robustness" : "", { range: [low - pad, high + pad] });
    layout.shapes.push(line(c, { xref: `x${suffix} domain`, yref: `y${suffix}`, x0: 0, x1: 1, y0: 0, y1: 0 }, { layer: "below" }));
    return {
      type: "scatter",
      mode: "markers",
      x: reals(values),
      y: robustness.map((value) => (value === null ? null : Math.max(low - pad, Math.min(high + pad, value)))),
      xaxis: `x${suffix}`,
      yaxis: `y${suffix}`,
      customdata: values.map((value, j) => safe(
        `${of.labels[j]}, ${verdicts[j]}: ${show(robustness[j])} at ${cut(name, 40)} = ${show(real(value))}`,
      )),
      hovertemplate: "%{customdata}<extra></extra>",
      marker: {
        symbol: verdicts.map((word) => symbols[word]),
        color: verdicts.map((word) => c[word]),
        size: 7,
        opacity: 0.8,
      },
    };
  });
  return { traces, layout };
}

function pairs(chart, c) {
  const points = chart.pairs.map(reals).filter((pair) => pair.every(Number.isFinite));
  const low = Math.min(0, ...points.flat());
  const high = Math.max(0, ...points.flat());
  const pad = (high - low || 1) * 0.06;
  const range = [low - pad, high + pad];
  return {
    traces: [
      {
        type: "scatter",
        mode: "markers",
        x: points.map(([a]) => a),
        y: points.map(([, b]) => b),
        customdata: points.map(([a, b]) => `A ${show(a)}, B ${show(b)}`),
        hovertemplate: "%{customdata}<extra></extra>",
        marker: { color: faded(c.signal, 0.7), size: 7 },
      },
    ],
    layout: frame(c, {
      xaxis: axis(c, "robustness of A", { range, showgrid: false }),
      yaxis: axis(c, "robustness of B", { range }),
      shapes: [
        zeroLine(c, "x"),
        zeroLine(c, "y"),
        line(c, { x0: range[0], x1: range[1], y0: range[0], y1: range[1] }, { line: { color: c.muted, width: 1, dash: "dot" } }),
      ],
    }),
  };
}

const dashes = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];

// Curves with bands. A colour is of a method, and so is a dash for eyes that do not tell colours apart.
function curves(chart, c) {
  const paints = [c.signal, c.violated, c.satisfied, c.undecided, c.muted];
  const traces = chart.curves.flatMap((curve, i) => {
    const color = paints[i % paints.length];
    return [
      {
        type: "scatter",
        mode: "lines",
        x: [...chart.places, ...chart.places.toReversed()],
        y: [...reals(curve.high), ...reals(curve.low).toReversed()],
        fill: "toself",
        fillcolor: faded(color, 0.15),
        line: { width: 0 },
        hoverinfo: "skip",
        showlegend: false,
      },
      {
        type: "scatter",
        mode: "lines",
        name: curve.name,
        x: chart.places,
        y: reals(curve.values),
        customdata: curve.values.map((value, k) => `${curve.name}: ${show(value)} (${show(curve.low[k])} to ${show(curve.high[k])})`),
        hovertemplate: "%{customdata}<extra></extra>",
        line: { color, width: 2, dash: dashes[i % dashes.length] },
      },
    ];
  });
  return {
    traces,
    layout: frame(c, {
      showlegend: true,
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", font: { size: 11 } },
      xaxis: axis(c, chart.x, { showgrid: false }),
      yaxis: axis(c, chart.y),
    }),
  };
}

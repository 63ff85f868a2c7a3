// Draws charts as they come into view, all of them for paper, and starts the rest.

const drawers = { histogram, violations, timeline, convergence, map, cases, pairs, curves, episode };
const paper = { wide: 680, half: 325 };
let onPaper = false;

function draw(plot) {
  const chart = data.charts[plot.dataset.chart];
  const wide = plot.parentElement.classList.contains("wide");
  const width = onPaper ? (wide ? paper.wide : paper.half) : plot.clientWidth;
  if (!width) return;
  plot.colours = colours();
  const { traces, layout } = drawers[chart.kind](chart, plot.colours, width);
  layout.height ??= Number.parseInt(plot.style.height, 10);
  plot.style.height = `${layout.height}px`;
  Plotly.react(plot, traces, { ...layout, width }, { displayModeBar: false, displaylogo: false, showTips: false, doubleClick: "reset" });
  if (!plot.drawn) firstDrawn(plot, chart);
  plot.drawn = width;
}

function firstDrawn(plot, chart) {
  const player = document.querySelector(`[data-player="${plot.dataset.chart}"]`);
  if (player) startPlayer(player, chart, plot);
}

function startCharts() {
  const plots = all("[data-chart]");
  const drawAgain = () => plots.filter((plot) => plot.drawn).forEach(draw);
  const near = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) if (isIntersecting && !target.drawn) draw(target);
  }, { rootMargin: "600px" });
  const sized = new ResizeObserver((entries) => {
    if (onPaper) return;
    for (const { target } of entries) if (target.drawn && target.clientWidth && target.drawn !== target.clientWidth) draw(target);
  });
  for (const plot of plots) {
    near.observe(plot);
    sized.observe(plot);
  }
  const print = (is) => {
    if (onPaper === is) return;
    onPaper = is;
    document.documentElement.classList.toggle("paper", is);
    if (is) plots.forEach(draw);
    else drawAgain();
  };
  addEventListener("beforeprint", () => print(true));
  addEventListener("afterprint", () => print(false));
  matchMedia("print").addEventListener("change", (event) => print(event.matches));
  return drawAgain;
}

async function copy(button) {
  try {
    await navigator.clipboard.writeText(button.dataset.copy);
  } catch {
    const field = make("textarea", { class: "unseen" });
    field.value = button.dataset.copy;
    button.after(field);
    field.select();
    document.execCommand("copy");
    field.remove();
    button.focus();
  }
  button.textContent = "Copied";
  setTimeout(() => {
    button.textContent = "Copy";
  }, 1500);
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("button.copy");
  if (button) copy(button);
});
for (const details of all("[data-samples]")) startSamples(details, data.charts[details.dataset.samples]);
const filter = new Filter();
startTheme(startCharts());

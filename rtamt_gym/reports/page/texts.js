// Numbers, names and elements. Names come from users: as text they are set by textContent, in
// charts they go through safe().

const data = JSON.parse(document.getElementById("data").textContent);

// JSON has no infinities: they are written as "inf" and "-inf".
function real(value) {
  if (value === "inf") return Infinity;
  if (value === "-inf") return -Infinity;
  return value;
}

function reals(values) {
  return values.map(real);
}

function show(value) {
  if (value === null || value === undefined) return "none";
  if (value === Infinity) return "∞";
  if (value === -Infinity) return "\u2212∞";
  return String(Number(value.toPrecision(5))).replaceAll("-", "\u2212");
}

function showTime(time, unit) {
  return unit === "s" ? `${show(time)} s` : `step ${show(time)}`;
}

function countOf(count, noun) {
  return count === 1 ? `1 ${noun}` : `${count} ${noun}s`;
}

function cut(text, length) {
  const signs = Array.from(text);
  return signs.length <= length ? text : `${signs.slice(0, Math.max(length - 1, 1)).join("")}…`;
}

// Plotly reads its texts as a kind of HTML with templates.
function safe(text) {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
}

function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

function all(selector, root = document) {
  return Array.from(root.querySelectorAll(selector));
}

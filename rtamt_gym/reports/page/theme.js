// Light and dark: the style sheet has the colours, charts read them from it.

const darkWanted = matchMedia("(prefers-color-scheme: dark)");
const colourNames = [
  "page", "raised", "ink", "muted", "line", "link", "signal", "bounds", "undecided",
  "satisfied", "violated", "failed", "satisfied-ink", "violated-ink",
];

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : darkWanted.matches;
}

// A computed colour is resolved for the theme, a custom property is not.
function colours() {
  const probe = make("span");
  document.body.append(probe);
  const found = {};
  for (const name of colourNames) {
    probe.style.color = `var(--${name})`;
    found[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  return found;
}

function faded(colour, opacity) {
  const [red, green, blue] = colour.match(/[\d.]+/g);
  return `rgba(${red},${green},${blue},${opacity})`;
}

function startTheme(changed) {
  const button = document.getElementById("theme");
  const tell = () => {
    button.setAttribute("aria-pressed", String(isDark()));
    changed();
  };
  const remembered = remember();
  if (remembered) document.documentElement.dataset.theme = remembered;
  button.setAttribute("aria-pressed", String(isDark()));
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = remember(isDark() ? "light" : "dark");
    tell();
  });
  darkWanted.addEventListener("change", tell);
}

// A browser may keep nothing of a page that is opened from a file.
function remember(theme) {
  try {
    if (theme) localStorage.setItem("theme", theme);
    return theme ?? localStorage.getItem("theme");
  } catch {
    return theme;
  }
}

// Tables of runs: sorted by a click on a head, and at first no longer than a reader wants.

const rowsAtFirst = 10;

class RunTable {
  constructor(table) {
    this.body = table.tBodies[0];
    this.rows = all("tr", this.body).map((element) => ({
      element,
      label: element.cells[0].textContent.trim(),
      text: plainText(element),
      verdict: element.dataset.verdict,
      matches: true,
    }));
    this.whole = false;
    this.more = make("button", { type: "button", class: "more" });
    this.more.addEventListener("click", () => {
      this.whole = !this.whole;
      this.arrange();
    });
    table.parentElement.after(this.more);
    all("thead th", table).forEach((head, i) => {
      if ("fixed" in head.dataset) return;
      const button = make("button", { type: "button" }, head.textContent);
      head.replaceChildren(button);
      button.addEventListener("click", () => this.sort(head, i));
    });
    this.arrange();
  }

  // Upwards, downwards, then worst first again.
  sort(head, column) {
    const next = { ascending: "descending", descending: "" }[head.getAttribute("aria-sort")] ?? "ascending";
    for (const each of all("th[aria-sort]", head.parentElement)) each.removeAttribute("aria-sort");
    if (next) head.setAttribute("aria-sort", next);
    const sign = next === "descending" ? -1 : 1;
    const sorted = next ? this.rows.toSorted((a, b) => compare(a, b, column, sign)) : this.rows;
    this.body.append(...sorted.map((row) => row.element));
    this.arrange();
  }

  filter(matches) {
    for (const row of this.rows) row.matches = matches(row);
    this.arrange();
    return this.rows.filter((row) => row.matches).length;
  }

  arrange() {
    const matching = new Set(this.rows.filter((row) => row.matches).map((row) => row.element));
    let shown = 0;
    for (const element of this.body.rows) {
      const matches = matching.has(element);
      const beyond = matches && !this.whole && shown >= rowsAtFirst;
      if (matches) shown += 1;
      element.hidden = !matches || beyond;
      element.toggleAttribute("data-beyond", beyond);
    }
    this.more.hidden = matching.size <= rowsAtFirst;
    this.more.textContent = this.whole ? `Show the first ${rowsAtFirst}` : `Show all ${matching.size}`;
  }

  reveal(element) {
    if (!element.hidden) return;
    this.whole = true;
    this.arrange();
  }
}

function compare(a, b, column, sign) {
  const [first, second] = [a, b].map((row) => keyOf(row.element.cells[column]));
  if (first === null || second === null) return (first === null) - (second === null);
  if (typeof first === "number" && typeof second === "number") return sign * (first < second ? -1 : Number(first > second));
  return sign * String(first).localeCompare(String(second), "en", { numeric: true });
}

// What a cell is sorted by; a cell without content comes last either way.
function keyOf(cell) {
  if (cell.dataset.value !== undefined) return Number(cell.dataset.value.replace("inf", "Infinity"));
  return cell.textContent.trim() || null;
}

// Text as a reader types it: small letters, plain hyphens.
function plainText(element) {
  return element.textContent.toLowerCase().replaceAll("\u2212", "-").replace(/\s+/g, " ");
}

// The filter, and the part of the address after # that keeps it, with the place on the page.

// The rows of a table of traces that are shown at first, and with each click on its button.
const rowsOfPage = 100;

class Filter {
  constructor() {
    this.form = document.getElementById("filter");
    this.state = { text: "", requirement: "", verdict: "", at: "" };
    this.articles = all("article.requirement").map((element) => ({
      element,
      name: element.dataset.requirement,
      key: element.dataset.key ?? "",
      section: element.closest("section.result").id,
      text: all(":scope > header", element).map(plainText).join(" "),
      glance: document.querySelector(`[data-glance="${element.id}"]`),
      tables: all("table.sortable", element).map((table) => new RunTable(table)),
      episodes: all("section.episode", element),
    }));
    this.buttons = new Map();
    this.form.addEventListener("submit", (event) => event.preventDefault());
    this.form.addEventListener("input", () => this.read());
    this.form.addEventListener("reset", () => setTimeout(() => this.read()));
    addEventListener("hashchange", () => this.restore());
    document.addEventListener("click", (event) => this.follow(event));
    document.addEventListener("scrollend", () => this.track());
    this.restore();
  }

  read() {
    for (const name of ["text", "requirement", "verdict"]) this.state[name] = this.form.elements[name].value;
    this.apply();
    this.write("replaceState");
  }

  get active() {
    return this.state.text.trim() !== "" || this.state.requirement !== "" || this.state.verdict !== "";
  }

  // A link to a place alone stays an ordinary one: #sweep; with a filter: #verdict=violated&at=sweep.
  get hash() {
    if (!this.active) return this.state.at;
    return new URLSearchParams(Object.entries(this.state).filter(([, value]) => value)).toString();
  }

  write(how) {
    const hash = this.hash;
    history[how](null, "", hash ? `#${hash}` : location.pathname + location.search);
  }

  restore() {
    const hash = location.hash.slice(1);
    const found = new URLSearchParams(hash.includes("=") ? hash : { at: decodeURIComponent(hash) });
    for (const name of Object.keys(this.state)) this.state[name] = found.get(name) ?? "";
    for (const name of ["text", "requirement", "verdict"]) this.form.elements[name].value = this.state[name];
    this.apply();
    this.reveal(this.state.at);
  }

  follow(event) {
    const link = event.target.closest('a[href^="#"]');
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
    const at = link.getAttribute("href").slice(1);
    event.preventDefault();
    this.state.at = at;
    this.write("pushState");
    const target = this.reveal(at);
    if (!target) return;
    if (target.tabIndex < 0) target.tabIndex = -1;
    target.focus({ preventScroll: true });
  }

  reveal(id) {
    for (const each of all(".at")) each.classList.remove("at");
    const target = id && document.getElementById(id);
    if (!target) return null;
    for (const { tables } of this.articles) for (const table of tables) if (table.body.contains(target)) table.reveal(target);
    target.classList.add("at");
    this.hold(() => target.scrollIntoView({ block: target.matches("tr") ? "center" : "start", behavior: "instant" }));
    return target;
  }

  // Charts that are drawn later may move a place: it is held until the reader does something.
  hold(place) {
    this.held?.abort();
    const held = new AbortController();
    this.held = held;
    const grown = new ResizeObserver(place);
    grown.observe(document.getElementById("main"));
    held.signal.addEventListener("abort", () => grown.disconnect());
    for (const event of ["wheel", "touchstart", "pointerdown", "keydown"]) {
      addEventListener(event, () => held.abort(), { signal: held.signal, passive: true });
    }
    place();
  }

  // The address follows the reader, unless what it names is held, or still in view.
  track() {
    if (this.held && !this.held.signal.aborted) return;
    const named = this.state.at && document.getElementById(this.state.at);
    const inView = (box) => box.bottom > 0 && box.top < innerHeight;
    if (named && named.getClientRects().length && inView(named.getBoundingClientRect())) return;
    const places = all("section.result, article.requirement, section.episode").filter((each) => each.getClientRects().length);
    const at = places.findLast((each) => each.getBoundingClientRect().top < innerHeight / 3);
    this.state.at = at?.id ?? "";
    this.write("replaceState");
  }

  apply() {
    const { requirement, verdict } = this.state;
    const text = this.state.text.trim().toLowerCase().replace(/\s+/g, " ");
    // A run stands in the table of each of its requirements, a requirement in each result: one of each.
    const count = { runs: new Set(), allRuns: new Set(), requirements: new Set(), allRequirements: new Set() };
    const add = (into, article, rows) => rows.forEach((row) => into.add(`${article.section} ${row.label}`));
    let anything = false;
    for (const article of this.articles) {
      const named = !requirement || article.name === requirement;
      const said = article.text.includes(text);
      const matches = (row) => named && (!verdict || row.verdict === verdict) && (said || row.text.includes(text));
      const runs = article.tables.reduce((sum, table) => sum + table.filter(matches), 0);
      const shown = named && (runs > 0 || (said && !verdict));
      for (const each of article.episodes) each.hidden = Boolean(verdict) && each.dataset.verdict !== verdict;
      article.element.hidden = !shown;
      if (article.glance) article.glance.hidden = !shown;
      for (const { rows } of article.tables) {
        add(count.runs, article, rows.filter((row) => row.matches));
        add(count.allRuns, article, rows);
      }
      if (article.key) {
        count.allRequirements.add(article.key);
        if (shown) count.requirements.add(article.key);
      }
      anything ||= shown;
    }
    const traces = all("table.matrix").reduce((sum, table) => sum + this.applyToMatrix(table, text), 0);
    for (const each of all("section.result, section.glance")) this.hideEmpty(each);
    document.getElementById("nothing").hidden = !this.active || anything || traces > 0;
    this.say(count);
    document.dispatchEvent(new Event("filtered"));
  }

  applyToMatrix(table, text) {
    const { requirement, verdict } = this.state;
    const heads = all("thead th", table);
    const off = heads.map((head) => Boolean(requirement) && head.dataset.requirement !== undefined && head.dataset.requirement !== requirement);
    const known = !requirement || heads.some((head) => head.dataset.requirement === requirement);
    const limit = Number(table.dataset.limit ?? rowsOfPage);
    let shown = 0;
    for (const row of all("tr", table)) {
      Array.from(row.cells).forEach((cell, i) => {
        cell.hidden = off[i];
      });
      if (row.parentElement.tagName === "THEAD") continue;
      const cells = Array.from(row.cells).filter((cell, i) => !off[i] && cell.dataset.verdict);
      const matches = known && (!verdict || cells.some((cell) => cell.dataset.verdict === verdict)) && plainText(row.cells[0]).includes(text);
      row.hidden = !matches || shown >= limit;
      shown += Number(matches);
    }
    table.parentElement.hidden = shown === 0;
    const more = this.moreOf(table);
    more.hidden = shown <= limit;
    more.textContent = `Show ${Math.min(rowsOfPage, shown - limit)} more of ${shown}`;
    return shown;
  }

  // The button below a long table, which shows its next rows.
  moreOf(table) {
    if (!this.buttons.has(table)) {
      const button = make("button", { type: "button", class: "more" });
      button.addEventListener("click", () => {
        table.dataset.limit = Number(table.dataset.limit ?? rowsOfPage) + rowsOfPage;
        this.apply();
      });
      table.parentElement.after(button);
      this.buttons.set(table, button);
    }
    return this.buttons.get(table);
  }

  hideEmpty(section) {
    const parts = all("article.requirement, [data-glance], table.matrix tbody tr", section);
    section.hidden = this.active && parts.length > 0 && parts.every((part) => part.hidden);
  }

  say(count) {
    const { requirements, allRequirements, runs, allRuns } = count;
    const listed = document.querySelector(".left-out") ? " listed" : "";
    const text = this.active
      ? `${requirements.size} of ${countOf(allRequirements.size, "requirement")}, ${runs.size} of ${countOf(allRuns.size, "run")}${listed}`
      : `${countOf(allRequirements.size, "requirement")}, ${countOf(allRuns.size, "run")}${listed}`;
    const place = document.getElementById("count");
    if (place.textContent !== text) place.textContent = text;
  }
}

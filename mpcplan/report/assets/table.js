// The table of scenarios: sorted by its headings, filtered, its rows opened by a click. On paper it
// has all rows that are chosen, and under those that failed the cause.
(function () {
  "use strict";
  const PAGE = 200; // rows shown at once, until all are asked for
  const CHOICES = 60; // a column of choices with more values than this has no list of its own
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("table-data").textContent);
  const columns = data.columns;
  const state = { sort: null, falling: false, search: "", choices: new Map(), pick: null, all: false, paper: false };
  const open = new Set();
  const statusAt = columns.findIndex((column) => column.label === "status");
  const scenarioAt = columns.findIndex((column) => column.label === "scenario");
  const haystacks = data.rows.map((row, index) => {
    const told = data.details[index];
    const texts = row.filter((cell) => typeof cell === "string");
    return [...texts, told.cause, told.late, told.notes, told.words].join("\n").toLowerCase();
  });

  function make(tag, fields, ...children) {
    const element = Object.assign(document.createElement(tag), fields);
    element.append(...children);
    return element;
  }

  // ---- which rows, in which order

  function chosen() {
    const words = state.search.toLowerCase().split(/\s+/).filter(Boolean);
    const picked = state.pick === null ? null : new Set(data.picks[state.pick].rows);
    const found = [];
    data.rows.forEach((row, index) => {
      if (picked && !picked.has(index)) return;
      for (const [at, value] of state.choices) if (row[at] !== value) return;
      if (words.every((word) => haystacks[index].includes(word))) found.push(index);
    });
    return state.sort === null ? found : found.sort(compare);
  }

  const names = new Intl.Collator("en", { numeric: true });

  function compare(a, b) {
    const [x, y] = [data.rows[a][state.sort], data.rows[b][state.sort]];
    const [noX, noY] = [x === null || x === "", y === null || y === ""];
    if (noX || noY) return noX - noY || a - b; // empty cells come last, whichever the direction
    const order = typeof x === "number" ? x - y : names.compare(x, y);
    return (state.falling ? -order : order) || a - b;
  }

  // ---- drawing

  function draw() {
    const found = chosen();
    const shown = state.all || state.paper ? found : found.slice(0, PAGE);
    const body = document.createDocumentFragment();
    for (const index of shown) {
      body.append(rowOf(index));
      if (open.has(index)) body.append(detailOf(index));
      else if (state.paper && failed(index)) body.append(causeOf(index));
    }
    byId("rows").tBodies[0].replaceChildren(body);
    const total = data.rows.length;
    const cut = shown.length < found.length ? `, the first ${shown.length} of them shown` : "";
    byId("count").textContent = `${found.length} of ${total} rows${cut}`;
    byId("more").hidden = !cut;
    byId("chosen").textContent = choiceInWords();
    byId("picked").hidden = state.pick === null;
    byId("picked").textContent = state.pick === null ? "" : data.picks[state.pick].label;
    byId("rows").querySelectorAll("th").forEach((head) => {
      if (Number(head.dataset.column) !== state.sort) head.removeAttribute("aria-sort");
      else head.setAttribute("aria-sort", state.falling ? "descending" : "ascending");
    });
  }

  function failed(index) {
    return data.rows[index][statusAt] !== "solved";
  }

  // What the reader of a printed page cannot see in the filters.
  function choiceInWords() {
    const words = [...state.choices].map(([at, value]) => `${columns[at].label} ${value}`);
    if (state.search.trim()) words.push(`with the words “${state.search.trim()}”`);
    if (state.pick !== null) words.push(data.picks[state.pick].label);
    if (state.sort !== null) words.push(`by ${columns[state.sort].label}${state.falling ? ", falling" : ""}`);
    return words.length ? `Chosen: ${words.join("; ")}` : "";
  }

  function causeOf(index) {
    const cell = make("td", { colSpan: columns.length }, data.details[index].cause || "no cause is known");
    return make("tr", { className: "why" }, cell);
  }

  function rowOf(index) {
    const row = make("tr", { className: "row" });
    row.dataset.row = index;
    data.rows[index].forEach((value, at) => {
      const column = columns[at];
      if (column.hidden) return;
      const cell = make("td", { className: column.kind === "number" ? "" : "left" });
      if (at === statusAt) cell.classList.add("status");
      if (at === scenarioAt) {
        const button = make("button", { type: "button", className: "open-row" }, value);
        button.setAttribute("aria-expanded", open.has(index));
        cell.append(button);
      } else cell.textContent = textOf(value, column);
      row.append(cell);
    });
    if (failed(index)) row.classList.add("failed");
    if (open.has(index)) row.classList.add("open");
    return row;
  }

  function textOf(value, column) {
    if (value === null || value === "") return "";
    return column.kind === "number" ? value.toFixed(column.digits) : value;
  }

  function detailOf(index) {
    const told = data.details[index];
    const cell = make("td", { colSpan: columns.length });
    const list = make("dl", {});
    for (const [name, text] of [["cause", told.cause], ["late", told.late], ["bound", told.bound], ["notes", told.notes]])
      if (text) list.append(make("dt", {}, name), make("dd", {}, text));
    if (list.children.length) cell.append(list);
    cell.append(linksOf(told));
    if (told.words) {
      const lines = told.words.split("\n").map((line) => make("span", { className: "line" }, line));
      cell.append(make("pre", {}, ...lines));
    } else cell.append(make("p", { className: "missing on-screen" }, "There is no trace of this run."));
    cell.append(...mediaOf(told));
    return make("tr", { className: "detail" }, cell);
  }

  function linksOf(told) {
    const links = make("div", { className: "links" });
    for (const name of ["picture", "animation", "trace", "solution"])
      if (told[name]) links.append(make("a", { href: told[name], target: "_blank" }, name));
    return links;
  }

  function mediaOf(told) {
    const found = [];
    const picture = told.embedded || told.picture;
    if (picture) found.push(pictureOf(picture, "picture of the drive"));
    else found.push(make("p", { className: "missing on-screen" }, "There is no picture of this run."));
    if (!told.animation) return found;
    if (told.animation.endsWith(".gif")) found.push(pictureOf(told.animation, "animation of the drive", "film"));
    else {
      const video = make("video", { controls: true, preload: "metadata", src: told.animation });
      const or = ", or this browser cannot play it";
      video.addEventListener("error", () => video.replaceWith(missing(told.animation, or)));
      found.push(video);
    }
    return found;
  }

  function pictureOf(source, what, kind = "picture") {
    const image = make("img", { alt: what, src: source, className: kind });
    image.addEventListener("error", () => image.replaceWith(missing(source)));
    return image;
  }

  function missing(source, or = "") {
    const name = decodeURIComponent(source);
    const text = `The file ${name} is not there (any more), seen from this page${or}.`;
    return make("p", { className: "missing" }, text);
  }

  // ---- what the user does

  function heads() {
    const row = make("tr", {});
    columns.forEach((column, at) => {
      if (column.hidden) return;
      const button = make("button", { type: "button", title: column.title }, column.label);
      const head = make("th", { className: column.kind === "number" ? "" : "left", scope: "col" }, button);
      head.dataset.column = at;
      button.addEventListener("click", () => {
        state.falling = state.sort === at && !state.falling;
        state.sort = at;
        draw();
      });
      row.append(head);
    });
    byId("rows").tHead.append(row);
  }

  function choices() {
    columns.forEach((column, at) => {
      const values = [...new Set(data.rows.map((row) => row[at]))].filter(Boolean).sort(names.compare);
      if (column.kind !== "choice" || values.length < 2 || values.length > CHOICES) return;
      const list = make("select", {}, make("option", { value: "" }, "all"));
      list.dataset.column = column.label;
      list.append(...values.map((value) => make("option", { value }, value)));
      list.addEventListener("change", () => {
        if (list.value) state.choices.set(at, list.value);
        else state.choices.delete(at);
        draw();
      });
      byId("choices").append(make("label", {}, `${column.label} `, list));
    });
  }

  function reset() {
    document.querySelector(".filters").reset();
    Object.assign(state, { search: "", pick: null, all: false });
    state.choices.clear();
  }

  function toggle(index) {
    if (!open.delete(index)) open.add(index);
    draw();
    const button = document.querySelector(`tr[data-row="${index}"] .open-row`);
    if (button) button.focus({ preventScroll: true });
  }

  byId("rows").tBodies[0].addEventListener("click", (event) => {
    const row = event.target.closest("tr.row");
    const marking = window.getSelection().type === "Range"; // text is being marked, to be copied
    if (row && !marking) toggle(Number(row.dataset.row));
  });
  byId("search").addEventListener("input", (event) => {
    state.search = event.target.value;
    draw();
  });
  document.querySelector(".filters").addEventListener("submit", (event) => event.preventDefault());
  byId("clear").addEventListener("click", () => { reset(); draw(); });
  byId("all").addEventListener("click", () => { state.all = true; draw(); });
  document.querySelectorAll(".pick").forEach((button) => {
    button.addEventListener("click", () => {
      reset();
      state.pick = Number(button.dataset.pick);
      draw();
      byId("scenarios").scrollIntoView();
    });
  });

  function paper(printed) {
    state.paper = printed;
    draw();
  }

  window.addEventListener("beforeprint", () => paper(true));
  window.addEventListener("afterprint", () => paper(false));

  heads();
  choices();
  draw();
  document.documentElement.dataset.table = "ready";
})();

// What pages and reports do beyond what they are: numbers are checked while they are typed, tables sort, filter and copy,
// an answer can follow the question, figures tell their values at the pointer, and a link to something folded opens it. Nothing here is needed to ask or to read.
"use strict";

const make = (tag, given, ...inside) => {
  const made = Object.assign(document.createElement(tag), given);
  made.append(...inside);
  return made;
};
const unitS = { s: 1, sec: 1, second: 1, seconds: 1, m: 60, min: 60, minute: 60, minutes: 60, h: 3600, hour: 3600, hours: 3600, d: 86400, day: 86400, days: 86400 };
const plain = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i;

// ---- numbers while they are typed ----

function words(data) {
  const parts = [];
  if (data.ge && data.le) parts.push(`${data.ge} to ${data.le}`);
  else {
    for (const [key, word] of [["ge", "at least"], ["gt", "above"], ["le", "at most"], ["lt", "below"]])
      if (data[key]) parts.push(`${word} ${data[key]}`);
  }
  const kind = { whole: "a whole number", several: "numbers between commas" }[data.number] || "a number";
  const unit = data.unit ? ` ${data.unit}` : "";
  return `${kind}${parts.length ? `, ${parts.join(", ")}${unit}` : unit && ` in ${data.unit}`}${data.number === "time" ? ", or with a unit as 2h" : ""}`;
}

function fault(input) {
  const data = input.dataset, text = input.value.trim();
  if (!text) return "";
  const texts = data.number === "several" ? text.split(/[,;\s]+/).filter(Boolean) : [text];
  const good = texts.every((item) => {
    let factor = 1;
    if (data.number === "time") {
      const found = item.match(/^(.*?\d\.?)\s*([a-z]+)$/i);
      if (found) {
        factor = unitS[found[2].toLowerCase()];
        item = found[1];
        if (!factor) return false;
      }
    }
    if (!plain.test(item) || (data.number === "whole" && !/^[-+]?\d+$/.test(item))) return false;
    const value = Number(item) * factor;
    return Number.isFinite(value) && !(value < data.ge || value <= data.gt || value > data.le || value >= data.lt);
  });
  return good ? "" : `${text}: ${words(data)}`;
}

function check(input) {
  const id = `live-${input.id}`, wrong = fault(input), field = input.closest(".field");
  let told = document.getElementById(id);
  if (!told && wrong) {
    told = make("span", { id, className: "wrong" });
    told.setAttribute("role", "status");
    input.after(told);
  }
  if (told) told.textContent = wrong;
  const served = document.getElementById(`wrong-${input.id}`);
  if (served) served.remove();
  field.classList.toggle("bad", Boolean(wrong));
  const about = ["about-" + input.id, ...(wrong ? [id] : [])];
  input.setAttribute("aria-describedby", about.join(" "));
  if (wrong) input.setAttribute("aria-invalid", "true");
  else input.removeAttribute("aria-invalid");
  return !wrong;
}

// ---- tables ----

const wide = new ResizeObserver((seen) => seen.forEach(({ target }) => target.classList.toggle("wider", target.scrollWidth > target.clientWidth)));

function value(cell) {
  const text = (cell ? cell.textContent : "").trim().replace("−", "-").replace(/[→✓·○□]/g, "").trim();
  const power = text.match(/^([-+]?[\d.]+)\s*×\s*10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/);
  if (power) return Number(power[1]) * 10 ** Number([...power[2]].map((sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(sign)).map((n) => (n ? n - 1 : "-")).join(""));
  const found = text.match(/^([-+]?(?:\d[\d  ]*\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(s|min|h|d)?(?=$|\s|%|×|″)/i);
  if (!found) return text === "–" || text === "" ? null : text.toLowerCase();
  return Number(found[1].replace(/[  ]/g, "")) * (unitS[found[2]] || 1);
}

const at = (row, column) => [...row.cells].flatMap((cell) => Array(cell.colSpan).fill(cell))[column];

function sort(table, column, head) {
  const down = head.getAttribute("aria-sort") === "ascending", body = table.tBodies[0];
  const rows = [...body.rows].map((row) => [value(at(row, column)), row]);
  rows.sort(([a], [b]) => {
    if (a === null || b === null) return (a === null) - (b === null);
    const order = typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b));
    return down ? -order : order;
  });
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  body.append(...rows.map(([, row]) => row));
}

function cells(table) {
  const shown = [...table.tBodies[0].rows].filter((row) => !row.hidden);
  return [...table.tHead.rows, ...shown].map((row) => [...row.cells].flatMap((cell) => {
    const copy = cell.cloneNode(true);
    for (const line of copy.querySelectorAll("br")) line.replaceWith(" ");
    return [copy.textContent.trim().replace(/\s+/g, " "), ...Array(cell.colSpan - 1).fill("")];
  }));
}

// A spreadsheet takes a text that begins so for a formula, unless an apostrophe stands before it.
const guarded = (text) => (/^'*[=+\-@\t\r]/.test(text) && !/^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(text) ? `'${text}` : text);
const asCsv = (rows) => rows.map((row) => row.map(guarded).map((text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text)).join(",")).join("\n") + "\n";
const tex = { "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}", "″": "$''$", "×": "$\\times$", "±": "$\\pm$", "−": "$-$", "✓": "", "·": "", "○": "", "□": "", "→": "", "–": "--", "☉": "$_\\odot$" };
const asLatex = ([head, ...rows]) => {
  const line = (row) => row.map((text) => text.replace(/[\\~^″×±−✓·○□→–☉]/g, (sign) => tex[sign]).replace(/[&%#_{}](?![^$]*\$)/g, "\\$&").trim()).join(" & ") + " \\\\\n";
  return `\\begin{tabular}{${"l".repeat(head.length)}}\n\\hline\n${line(head)}\\hline\n${rows.map(line).join("")}\\hline\n\\end{tabular}\n`;
};

async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = make("textarea", { value: text, className: "unseen" });
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  const said = button.textContent;
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = said), 1500);
}

function equip(table) {
  if (!table.tHead || !table.tBodies[0] || table.dataset.equipped) return;
  table.dataset.equipped = "yes";
  const rows = table.tBodies[0].rows, label = table.caption ? table.caption.textContent.trim().split(".")[0] : "table";
  const listed = !table.classList.contains("bands"); // its rows are quantities, in an order that means something
  if (listed && rows.length > 1)
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = make("button", { type: "button", className: "sort", title: "Sort" }, ...head.childNodes);
      button.addEventListener("click", () => sort(table, column, head));
      head.replaceChildren(button);
    });
  const scroll = table.closest(".scroll"), bar = make("p", { className: "tools" });
  if (listed && rows.length > 7) {
    const input = make("input", { type: "text", placeholder: "Filter rows", autocomplete: "off" });
    input.setAttribute("aria-label", `Filter rows of ${label}`);
    input.addEventListener("input", () => {
      const wanted = input.value.trim().toLowerCase();
      for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
    });
    scroll.before(make("p", { className: "tools" }, input));
  }
  for (const [name, form] of [["Copy as CSV", asCsv], ["Copy as LaTeX", asLatex]]) {
    const button = make("button", { type: "button", textContent: name });
    button.setAttribute("aria-label", `${name}: ${label}`);
    button.addEventListener("click", () => copy(form(cells(table)), button));
    bar.append(button);
  }
  scroll.after(bar);
  wide.observe(scroll);
}

// ---- an answer that follows the question ----

function follow(form) {
  const answer = document.querySelector(".answer");
  if (!answer || form.method !== "get") return;
  const box = make("input", { type: "checkbox" }), said = make("span", { className: "unit" });
  said.setAttribute("role", "status");
  form.querySelector("button[type=submit]").parentNode.append(make("label", { className: "follow" }, box, " Answer while I type "), said);
  let waiting = 0, asked = 0;
  const ask = async () => {
    const pairs = [...new FormData(form)].filter(([, text]) => text.trim()), address = `${form.action}?${new URLSearchParams(pairs)}`;
    const mine = ++asked;
    said.textContent = "asking";
    const told = await fetch(address).catch(() => null);
    if (mine !== asked) return;
    const page = told && new DOMParser().parseFromString(await told.text(), "text/html");
    const found = page && page.querySelector(".answer");
    said.textContent = found ? "answered" : "no answer to this";
    if (!found) return;
    answer.replaceChildren(...found.childNodes);
    answer.querySelectorAll("table").forEach(equip);
    history.replaceState(null, "", told.url);
    const there = document.querySelector(".sources"), next = page.querySelector(".sources");
    if (there && next) there.replaceWith(next);
  };
  form.addEventListener("input", (event) => {
    clearTimeout(waiting);
    if (box.checked && event.target !== box && !form.querySelector("[aria-invalid]")) waiting = setTimeout(ask, 500);
  });
}

// ---- the values of a figure at the pointer ----

const shown = make("div", { className: "at-pointer", hidden: true }), read = new WeakMap();
shown.setAttribute("aria-hidden", "true"); // the same values stand in tables

async function fetched(drawn) {
  const { panels, values } = drawn.dataset;
  if (panels) return JSON.parse(panels);
  const told = await fetch(values).catch(() => null);
  const page = told && told.ok && new DOMParser().parseFromString(await told.text(), "text/html");
  const found = page && page.querySelector("[data-panels]");
  return found ? JSON.parse(found.dataset.panels) : [];
}

const along = ({ log, low, high }, share) => (log ? low * (high / low) ** share : low + share * (high - low));
const spoken = (number, days) => (days ? new Date(Math.floor(number) * 864e5).toISOString().slice(0, 10) : String(Number(number.toPrecision(4))));

function valuesAt(panel, across, up) {
  const place = along(panel.x, across), row = Math.round(along(panel.y, up));
  if (panel.rows.length) return [`${panel.rows[row]}, ${panel.x.label}`, ...panel.bars.filter((bar) => bar.row === row).map((bar) => `${bar.name}: ${spoken(bar.high - bar.low)}`)];
  const far = panel.x.log ? (x) => Math.abs(Math.log(x / place)) : (x) => Math.abs(x - place);
  const found = panel.lines.flatMap(({ name, x, y }) => {
    const nearest = x.reduce((best, one, number) => (far(one) < far(x[best]) ? number : best), 0), inside = place >= x[0] && place <= x[x.length - 1];
    return inside && y[nearest] !== null ? [`${name}: ${spoken(y[nearest])}`] : [];
  });
  return [`${panel.x.label}: ${spoken(place, panel.x.days)}`, ...found, ...panel.levels.map(({ name, y }) => `${name}: ${spoken(y)}`)];
}

addEventListener("pointermove", async (event) => {
  const drawn = event.target instanceof Element && event.target.closest(".drawn[data-values], .drawn[data-panels]");
  if (!drawn) {
    shown.hidden = true;
    return;
  }
  if (!read.has(drawn)) read.set(drawn, fetched(drawn));
  const panels = await read.get(drawn), image = drawn.querySelector("img"), edge = image.getBoundingClientRect();
  const pad = image.clientLeft + parseFloat(getComputedStyle(image).paddingLeft);
  const across = (event.clientX - edge.left - pad) / (edge.width - 2 * pad), up = 1 - (event.clientY - edge.top - pad) / (edge.height - 2 * pad);
  const panel = panels.find(({ box: [left, bottom, wide, high] }) => across >= left && across <= left + wide && up >= bottom && up <= bottom + high);
  const lines = panel ? valuesAt(panel, (across - panel.box[0]) / panel.box[2], (up - panel.box[1]) / panel.box[3]) : [];
  shown.hidden = lines.length < 2;
  shown.textContent = lines.join("\n");
  if (shown.hidden) return;
  if (!shown.isConnected) document.body.append(shown);
  shown.style.left = `${Math.max(4, Math.min(event.clientX + 16, innerWidth - shown.offsetWidth - 8))}px`;
  shown.style.top = `${Math.max(4, Math.min(event.clientY + 16, innerHeight - shown.offsetHeight - 8))}px`;
});

// ---- what is folded ----

function unfold() {
  const there = document.getElementById(location.hash.slice(1));
  for (let fold = there && there.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
  if (there) there.scrollIntoView();
}

addEventListener("hashchange", unfold);
if (location.hash) unfold();
document.querySelectorAll("input[data-number]").forEach((input) => input.addEventListener("input", () => check(input)));
document.querySelectorAll("form").forEach((form) => {
  form.addEventListener("submit", (event) => {
    const wrong = [...form.querySelectorAll("input[data-number]")].filter((input) => !check(input));
    if (!wrong.length) return;
    event.preventDefault();
    for (let fold = wrong[0].closest("details"); fold; fold = null) fold.open = true;
    wrong[0].focus();
  });
  follow(form);
});
document.querySelectorAll(".scroll table").forEach(equip);

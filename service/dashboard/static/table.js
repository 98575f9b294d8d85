/** Tables that sort by any column and work with pointer and keyboard. */

import { el, fill } from "./dom.js";

/** @import { Child } from "./dom.js" */

/**
 * @template T
 * @typedef {{
 *   key: string, title: string, unit?: string, numeric?: boolean, minor?: boolean,
 *   value?: (row: T) => number | string | null, cell: (row: T) => Child | Child[],
 * }} Column  `value` is what the column is sorted by, where it can be; `minor` columns hide on narrow screens
 */

/**
 * @template T
 */
export class Table {
  /**
   * @param {HTMLElement} place
   * @param {string} caption read out, not shown
   * @param {Column<T>[]} columns
   * @param {{
   *   id: (row: T) => string, href?: (row: T) => string, sort?: string, descending?: boolean,
   *   onSort?: (key: string, descending: boolean) => void,
   * }} how  with `href` a row leads somewhere; with `onSort` rows come sorted from the service
   */
  constructor(place, caption, columns, how) {
    this.place = place;
    this.caption = caption;
    this.columns = columns;
    this.how = how;
    this.sort = { key: how.sort ?? "", descending: how.descending ?? false };
    /** @type {T[]} */
    this.rows = [];
    place.classList.add("scroll");
    place.addEventListener("keydown", (event) => this.move(event));
  }

  /** @param {T[]} rows */
  show(rows) {
    this.rows = rows;
    this.draw();
  }

  draw() {
    const focused = document.activeElement?.closest("tr[data-id]");
    const kept = focused && this.place.contains(focused) ? focused.getAttribute("data-id") : null;
    const rows = this.how.onSort ? this.rows : this.sorted();
    fill(
      this.place,
      el(
        "table",
        {},
        el("caption", { class: "visually-hidden" }, this.caption),
        el("thead", {}, el("tr", {}, this.columns.map((column) => this.head(column)))),
        el("tbody", {}, rows.map((row, i) => this.line(row, i === 0))),
      ),
    );
    if (kept) this.focus(this.place.querySelector(`tr[data-id="${CSS.escape(kept)}"]`));
  }

  sorted() {
    const column = this.columns.find(({ key }) => key === this.sort.key);
    const value = column?.value;
    if (!value) return this.rows;
    const sign = this.sort.descending ? -1 : 1;
    return [...this.rows].sort((a, b) => sign * compare(value(a), value(b)));
  }

  /** @param {Column<T>} column */
  head(column) {
    const title = [column.title, column.unit && el("small", {}, ` ${column.unit}`)];
    const isSorted = column.key === this.sort.key;
    const order = isSorted ? (this.sort.descending ? "descending" : "ascending") : "none";
    const content = column.value ? el("button", { type: "button", onclick: () => this.sortBy(column.key) }, title) : title;
    return el("th", { scope: "col", class: classes(column), "aria-sort": column.value ? order : null }, content);
  }

  /** @param {string} key */
  sortBy(key) {
    this.sort = { key, descending: this.sort.key === key && !this.sort.descending };
    if (this.how.onSort) this.how.onSort(this.sort.key, this.sort.descending);
    else this.draw();
  }

  /**
   * @param {T} row
   * @param {boolean} isFirst
   */
  line(row, isFirst) {
    const href = this.how.href?.(row);
    const cells = this.columns.map((column) => el("td", { class: classes(column) }, column.cell(row)));
    // The first cell holds a real link, so that a row opens in another tab as well.
    if (href) cells[0].replaceChildren(el("a", { href, tabindex: -1 }, ...cells[0].childNodes));
    const go = (/** @type {Event} */ event) => {
      if (href && !(/** @type {Element} */ (event.target).closest("a, button, input, label"))) window.location.assign(href);
    };
    return el("tr", { "data-id": this.how.id(row), class: href ? "link" : null, tabindex: isFirst ? 0 : -1, onclick: go }, cells);
  }

  /** @param {KeyboardEvent} event */
  move(event) {
    const row = /** @type {HTMLElement} */ (event.target).closest("tr[data-id]");
    if (!row || event.target !== row) return;
    if (event.key === "Enter") /** @type {HTMLElement | null} */ (row.querySelector("a"))?.click();
    else if (event.key === "ArrowDown") this.focus(row.nextElementSibling);
    else if (event.key === "ArrowUp") this.focus(row.previousElementSibling);
    else return;
    event.preventDefault();
  }

  /** @param {Element | null} row */
  focus(row) {
    if (!(row instanceof HTMLElement)) return;
    for (const other of this.place.querySelectorAll("tr[data-id]")) other.setAttribute("tabindex", "-1");
    row.setAttribute("tabindex", "0");
    row.focus();
  }
}

/**
 * Compare two values; what is missing comes last.
 * @param {number | string | null} a
 * @param {number | string | null} b
 */
function compare(a, b) {
  if (a === null || b === null) return Number(a === null) - Number(b === null);
  return a < b ? -1 : a > b ? 1 : 0;
}

/** @param {{ numeric?: boolean, minor?: boolean }} column */
function classes(column) {
  return [column.numeric ? "number" : "", column.minor ? "minor" : ""].filter(Boolean).join(" ") || null;
}

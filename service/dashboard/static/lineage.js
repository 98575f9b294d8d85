/** The lineage of a solution: its seeds above it and the solutions that it seeded below, as linked boxes. */

import { svg } from "./dom.js";
import { SvgFigure } from "./figures.js";
import { number, shortId } from "./format.js";
import { compareStrategies, lookOf } from "./looks.js";
import { colour } from "./theme.js";

/** @import { Child, LineageGraph, LineageNode } from "../types" */

/** @typedef {{ x: number, y: number }} Place */

const BOX = { width: 168, height: 44 };
/** Below this width boxes are narrower, so that two fit side by side. */
const [NARROW, NARROW_BOX] = [420, 137];
const GAP = { x: 12, y: 46 };
/** Gap between children, and height of the heading of a group of them. */
const CHILD_GAP = 10;
const GROUP_HEAD = 26;
const INDENT = 26;

export class LineageFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Lineage");
  }

  /** @param {LineageGraph} lineage */
  show(lineage) {
    this.figure.show((width) => drawing(lineage, width), ...caption(lineage));
    this.figure.plot.dataset.children = String(lineage.children.length);
  }
}

/** @param {LineageGraph} lineage */
function caption({ nodes, children, n_children: all, n_mapped: solves }) {
  const seeds = nodes.length > 1 ? "Seeds are above; each was mapped to a guess that became the next. " : "Its guess was drawn at random. ";
  if (solves === 0) return [`${seeds}No guess was made from this solution.`];
  const shown = children.length < all ? `Below are the ${number(children.length, 0)} with the highest final mass.` : "";
  return [`${seeds}${number(solves, 0)} guesses were made from this solution; ${number(all, 0)} became solutions. ${shown}`];
}

/**
 * @param {LineageGraph} lineage
 * @param {number} width
 */
function drawing(lineage, width) {
  const boxWidth = width < NARROW ? NARROW_BOX : BOX.width;
  const rows = layers(lineage);
  /** @type {Map<string, Place>} */
  const places = new Map();
  rows.forEach((row, depth) => {
    const gap = Math.min(GAP.x * 3, (width - row.length * boxWidth) / Math.max(1, row.length - 1));
    row.forEach((node, i) => places.set(node.id, { x: i * (boxWidth + gap), y: 2 + depth * (BOX.height + GAP.y) }));
  });
  const lines = edges(lineage, places);
  const boxes = lineage.nodes.map((node) => box(node, /** @type {Place} */ (places.get(node.id)), boxWidth, node.id === lineage.id));
  const top = rows.length * (BOX.height + GAP.y) - GAP.y + 2;
  const below = groups(lineage, top, width, boxWidth);
  return { height: below.height, content: [...lines, ...below.content, ...boxes] };
}

/**
 * Return the solution and its seeds in layers, the oldest first; each layer is one mapping apart.
 * @param {LineageGraph} lineage
 */
function layers({ id, nodes, edges }) {
  /** @type {Map<string, number>} */
  const depths = new Map([[id, 0]]);
  // The longest path has fewer edges than there are nodes.
  for (let round = 0; round < nodes.length; round += 1) {
    for (const { seed_id: seed, solution_id: child } of edges) {
      const depth = (depths.get(child) ?? -Infinity) + 1;
      if (depth > (depths.get(seed) ?? -Infinity) && depth < nodes.length) depths.set(seed, depth);
    }
  }
  const deepest = Math.max(...depths.values());
  return Array.from({ length: deepest + 1 }, (_, i) => nodes.filter((node) => depths.get(node.id) === deepest - i));
}

/**
 * @param {LineageGraph} lineage
 * @param {Map<string, Place>} places
 */
function edges(lineage, places) {
  /** @type {Map<string, string[]>} */
  const mappings = new Map();
  for (const { seed_id: seed, solution_id: child, mapping } of lineage.edges) {
    const key = `${seed} ${child}`;
    mappings.set(key, [...(mappings.get(key) ?? []), mapping]);
  }
  return [...mappings].flatMap(([key, names]) => {
    const [from, to] = key.split(" ").map((id) => places.get(id));
    if (!from || !to) return [];
    const [x1, y1, x2, y2] = [from.x + 24, from.y + BOX.height, to.x + 24, to.y];
    const middle = (y1 + y2) / 2;
    const path = `M${x1},${y1} C${x1},${middle} ${x2},${middle} ${x2},${y2 - 5}`;
    return [
      svg("path", { d: path, fill: "none", stroke: colour("line-strong"), "stroke-width": 1.5 }),
      arrow(x2, y2),
      svg("text", { x: (x1 + x2) / 2 + 10, y: middle + 4, fill: colour("muted"), "font-size": 11.5 }, names.sort().join(", ")),
    ];
  });
}

/**
 * @param {number} x
 * @param {number} y
 */
function arrow(x, y) {
  return svg("path", { d: `M${x - 4},${y - 7} L${x},${y - 1} L${x + 4},${y - 7} Z`, fill: colour("line-strong") });
}

/**
 * Return the children, by strategy and mapping, as branches of one trunk.
 * @param {LineageGraph} lineage
 * @param {number} top
 * @param {number} width
 * @param {number} boxWidth
 */
function groups(lineage, top, width, boxWidth) {
  /** @type {Map<string, Child[]>} */
  const grouped = new Map();
  for (const child of lineage.children) {
    const key = `${child.strategy} ${child.mapping}`;
    grouped.set(key, [...(grouped.get(key) ?? []), child]);
  }
  const ordered = [...grouped.values()].sort((a, b) => compareStrategies(a[0].strategy, b[0].strategy) || (a[0].mapping < b[0].mapping ? -1 : 1));
  const perRow = Math.max(1, Math.floor((width - INDENT - 14 + CHILD_GAP) / (boxWidth + CHILD_GAP)));
  const content = [];
  let y = top + 14;
  let last = top;
  for (const children of ordered) {
    last = y + GROUP_HEAD / 2;
    content.push(svg("path", { d: `M24,${last} H${INDENT + 14}`, stroke: colour("line-strong"), "stroke-width": 1.5, fill: "none" }));
    const words = `${children[0].mapping} → ${children[0].strategy}, ${number(children.length, 0)} shown`;
    content.push(svg("text", { x: INDENT + 20, y: last + 4, fill: colour("muted"), "font-size": 11.5 }, words));
    y += GROUP_HEAD;
    children.forEach((child, i) => {
      const place = { x: INDENT + 14 + (i % perRow) * (boxWidth + CHILD_GAP), y: y + Math.floor(i / perRow) * (BOX.height + CHILD_GAP) };
      content.push(box(child, place, boxWidth, false));
    });
    y += Math.ceil(children.length / perRow) * (BOX.height + CHILD_GAP) + 4;
  }
  if (ordered.length) content.unshift(svg("path", { d: `M24,${top} V${last}`, stroke: colour("line-strong"), "stroke-width": 1.5, fill: "none" }));
  return { content, height: Math.max(top + 4, y) };
}

/**
 * @param {LineageNode} node
 * @param {Place} place
 * @param {number} width
 * @param {boolean} isThis
 */
function box(node, { x, y }, width, isThis) {
  const look = lookOf(node.strategy);
  const value = `${number(node.delta_v_km_s, 4)} km/s`;
  const label = `${node.strategy} ${shortId(node.id)}, ${value}, ${node.strict ? "strict" : "loose only"}${isThis ? ", this solution" : ""}`;
  const frame = {
    x: 0.75, y: 0.75, width: width - 1.5, height: BOX.height - 1.5, rx: 8,
    fill: colour(isThis ? "raised" : "card"), stroke: isThis ? colour("accent") : colour("line-strong"), "stroke-width": isThis ? 2 : 1,
  };
  const content = [
    svg("title", {}, label),
    svg("rect", frame),
    svg("rect", { x: 8, y: 10, width: 4, height: BOX.height - 20, rx: 2, fill: look.color }),
    svg("text", { x: 20, y: 18, "font-weight": 600 }, node.strategy),
    svg("text", { x: width - 10, y: 18, "text-anchor": "end", fill: colour("muted"), "font-size": 11, "font-family": "monospace" }, shortId(node.id)),
    svg("text", { x: 20, y: 35, fill: colour("muted"), "font-size": width < BOX.width ? 10.5 : 11.5 }, `${width < BOX.width ? "" : "Δv "}${value}${node.strict ? "" : " · loose"}`),
  ];
  const at = { transform: `translate(${x},${y})`, "data-node": node.id };
  if (isThis) return svg("g", { ...at, "aria-current": "page" }, content);
  return svg("a", { ...at, href: `/solutions/${node.id}`, "aria-label": label }, content);
}

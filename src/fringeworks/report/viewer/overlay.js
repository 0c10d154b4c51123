// What lies over a panel of the picture: axes, marks, the point that is pointed at, and flags.

import { drawProfile } from "./lines.js";
import { make } from "./numbers.js";

const AXIS_PX = 28;

/** Axes, marks of the picks and, beside another one, the name of a panel. */
export function drawPanel(viewer, over, put) {
  const { view, active, tools, pointed, areas } = viewer;
  const at = (i) => view.project(active[0].shown.subarray(3 * i, 3 * i + 3));
  const [name, axes, ...rest] = over.children;
  const [marks, [dot, flags, lines, grips]] = [rest.slice(0, 2), rest.slice(2)];
  name.hidden = active.length < 2;
  for (const [k, axis] of [...axes.children].entries()) {
    const [line, text] = axis.children;
    const [x, y, z] = [0, 1, 2].map((m) => (m === k ? AXIS_PX : 0));
    const end = view.turn.transformPoint({ x, y, z });
    line.setAttribute("d", `M0 0L${end.x} ${-end.y}`);
    text.setAttribute("transform", `translate(${1.3 * end.x} ${-1.3 * end.y})`);
  }
  for (const [k, mark] of marks.entries()) {
    const i = tools.picks[k];
    mark.hidden = i === undefined;
    if (!mark.hidden) put(mark, ...at(i));
  }
  const [profile, outlines] = lines.children;
  // The surface of this panel: its own marks, and areas on the first one.
  drawProfile(viewer, profile);
  areas?.draw(active[0], outlines, grips, put);
  dot.hidden = !(pointed >= 0) || Boolean(active[0].reason[pointed]);
  if (!dot.hidden) put(dot, ...at(pointed));
  const shown = active[0].header.flags ?? [];
  while (flags.children.length > shown.length) flags.lastChild.remove();
  for (const [k, [i, text]] of shown.entries()) {
    const flag = flags.children[k] ?? flags.appendChild(make("i"));
    if (flag.textContent !== text) flag.replaceChildren(make("b", text));
    put(flag, ...at(i));
  }
}

// The table of the parts of a batch: drawn and searched here, so that thousands stay quick.

const STATES = { pass: "fw-good", fail: "fw-bad", undecided: "fw-warn", "not measured": "fw-bad" };

const cell = (kind, content, style = "") => {
  const made = document.createElement(kind);
  made.className = style;
  made.append(content);
  return made;
};

const link = (text, address) => {
  const made = document.createElement("a");
  Object.assign(made, { href: address, textContent: text, target: "_blank", rel: "noopener" });
  return made;
};

const row = ({ part, verdict, values, why, report }) => {
  const made = document.createElement("tr");
  const name = cell("th", report ? link(part, `/report/${report}`) : part);
  name.scope = "row";
  const figures = values.map((value) => cell("td", value, "fw-figure-cell"));
  made.append(name, cell("td", verdict, STATES[verdict] ?? ""), ...figures, cell("td", why));
  return made;
};

/** Draw the parts in an element: those that have the words and the verdict that are asked for. */
export const show = (id, columns, rows, { text = "", verdict = "" }) => {
  const place = document.getElementById(id);
  if (!place) return 0;
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  const wanted = rows.filter(
    (one) =>
      (!verdict || one.verdict === verdict) &&
      words.every((word) => `${one.part} ${one.why}`.toLowerCase().includes(word)),
  );
  const head = document.createElement("tr");
  for (const name of ["part", "verdict", ...columns, "why"]) {
    const made = cell("th", name);
    made.scope = "col";
    head.append(made);
  }
  const table = document.createElement("table");
  table.className = "fw-table";
  const [top, body] = ["thead", "tbody"].map((kind) => document.createElement(kind));
  top.append(head);
  body.append(...wanted.map(row));
  table.append(cell("caption", `${wanted.length} of ${rows.length} parts`, "fw-quiet"), top, body);
  place.replaceChildren(table);
  return wanted.length;
};

// Searches the tables that offer it: rows with all words stay.

for (const box of document.querySelectorAll(".search")) {
  const [input, told] = [box.querySelector("input"), box.querySelector("output")];
  const rows = [...box.nextElementSibling.querySelectorAll("tbody tr")];
  const texts = rows.map((row) => row.textContent.toLowerCase());
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const [k, row] of rows.entries()) {
      row.hidden = !words.every((word) => texts[k].includes(word));
      count += !row.hidden;
    }
    told.textContent = words.length ? `${count} of ${rows.length}` : "";
  });
}

for (const table of document.querySelectorAll(".table table")) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.lastElementChild.cells];
  const key = (row, i) => row.cells[i].dataset.key ?? row.cells[i].textContent;
  heads.forEach((head, i) => head.firstElementChild.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    const rows = [...body.rows];
    const value = (row) => (key(row, i) === "inf" ? Infinity : Number(key(row, i)));
    const numeric = rows.every((row) => !Number.isNaN(value(row)));
    rows.sort((a, b) => (numeric ? value(a) - value(b) || 0 : key(a, i).localeCompare(key(b, i), "en", { numeric: true })));
    if (down) rows.reverse();
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    body.append(...rows);
  }));
}

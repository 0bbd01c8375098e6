// Tables whose rows the headings sort, by mouse and keyboard.

/** Makes a button of each heading; a second press turns the order around. */
export function sortable(table) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const key = (row) => Number(row.cells[column].dataset.v ?? row.cells[column].textContent);
      const rows = [...body.rows].sort((a, b) => (down ? key(b) - key(a) : key(a) - key(b)));
      body.append(...rows);
    });
  });
}


"use strict";
const form = document.querySelector("form.filters");
const objects = [...document.querySelectorAll("details.object")];

function fits({ dataset }) {
  const { text, severity, category, flag } = form.elements;
  return (
    dataset.object.toLowerCase().includes(text.value.trim().toLowerCase()) &&
    (!severity.value || dataset.severity === severity.value) &&
    (!category.value || dataset.category === category.value) &&
    (!flag.value || dataset.flags.split(" ").includes(flag.value))
  );
}

function filter() {
  let shown = 0;
  for (const object of objects) {
    object.hidden = !fits(object);
    shown += !object.hidden;
  }
  form.querySelector("output").value = `${shown} of ${objects.length} objects`;
}

function openTarget() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (target) {
    target.open = true;
    target.hidden = false;
    target.scrollIntoView();
  }
}

for (const button of document.querySelectorAll("button[data-flag]")) {
  button.addEventListener("click", () => {
    form.elements.flag.value = button.dataset.flag;
    filter();
    form.scrollIntoView();
  });
}
if (matchMedia("(max-width: 40rem)").matches) {
  for (const section of document.querySelectorAll("details.section")) section.open = false;
}
form.hidden = false;
form.addEventListener("input", filter);
form.addEventListener("submit", (event) => event.preventDefault());
window.addEventListener("hashchange", openTarget);
filter();
openTarget();

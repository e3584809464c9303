// Shows the messages that contain every word of the field, and opens them when they are few.
"use strict";
document.addEventListener("DOMContentLoaded", () => {
  const field = document.getElementById("find-message");
  field?.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean), all = [...document.querySelectorAll("details.message")];
    const shown = all.filter(each => words.every(word => each.textContent.toLowerCase().includes(word)));
    for (const each of document.querySelectorAll("details.messages")) each.open = words.length > 0;
    for (const each of all) { each.hidden = !shown.includes(each); each.open = words.length > 0 && !each.hidden && shown.length <= 8; }
  });
});

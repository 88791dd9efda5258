// Buttons that copy the text beside them. Where a browser keeps pages from the clipboard, the text is marked instead.
"use strict";
for (const button of document.querySelectorAll("[data-copy]")) {
  const text = button.closest(".copyable").querySelector("pre");
  button.hidden = false;
  const mark = () => {
    const range = document.createRange();
    range.selectNodeContents(text);
    const selection = getSelection();
    selection.removeAllRanges();
    selection.addRange(range);
  };
  button.addEventListener("click", async () => {
    mark();
    try {
      await navigator.clipboard.writeText(text.textContent);
      button.textContent = "Copied";
    } catch {
      button.textContent = document.execCommand("copy") ? "Copied" : "Marked: press Ctrl+C";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  });
}

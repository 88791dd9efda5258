"use strict";
/* Pictures of views that the page holds once, shown where blocks name them. */
(() => {
  const pictures = report.data.pictures || {};
  for (const image of document.querySelectorAll("image[data-picture]")) {
    const uri = pictures[image.dataset.picture];
    if (uri) image.setAttribute("href", uri); else image.remove();
  }
})();

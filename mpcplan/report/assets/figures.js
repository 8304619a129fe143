// Draws the figures one after the other, so that the page can be used meanwhile.
(function () {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures-data").textContent);
  const waiting = [...document.querySelectorAll(".figure")];
  const settings = { displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] };

  function drawNext() {
    const place = waiting.shift();
    if (place) {
      const figure = figures[Number(place.dataset.figure)];
      Plotly.newPlot(place, figure.data, figure.layout, settings);
    }
    if (waiting.length) return true;
    document.documentElement.dataset.figures = "ready";
    return false;
  }

  function draw() {
    if (drawNext()) setTimeout(draw, 0);
  }

  window.addEventListener("beforeprint", () => { while (drawNext()); });
  setTimeout(draw, 0);
})();

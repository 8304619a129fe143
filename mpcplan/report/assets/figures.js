// Draws the figures one after the other. plotly.js lies in the page as text and is run only after the
// page has loaded: that takes longer than all the rest, and the tables can be read meanwhile.
(function () {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures-data").textContent);
  const waiting = [...document.querySelectorAll(".figure")];
  const settings = { displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] };

  function loadPlotly() {
    if (window.Plotly) return;
    const script = document.createElement("script");
    script.textContent = document.getElementById("plotly-source").textContent;
    document.head.append(script);
  }

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
    loadPlotly();
    if (drawNext()) setTimeout(draw, 0);
  }

  window.addEventListener("beforeprint", () => {
    loadPlotly();
    while (drawNext());
  });
  window.addEventListener("load", () => setTimeout(draw, 100));
})();

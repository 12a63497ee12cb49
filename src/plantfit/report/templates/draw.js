// Draws every figure with the colours of the page and draws again when light and dark change.
(() => {
  "use strict";
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const figures = read("figures");
  const config = read("config");
  const colour = /^var\((--[a-z0-9-]+)\)$/;

  const resolved = (value, css) => {
    if (typeof value === "string") {
      const match = colour.exec(value);
      return match ? css.getPropertyValue(match[1]).trim() || value : value;
    }
    if (Array.isArray(value)) {
      return typeof value[0] === "number" ? value : value.map((item) => resolved(item, css));
    }
    if (value === null || typeof value !== "object") return value;
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, resolved(item, css)]));
  };

  // plotly.js lies in the page compressed, as base64: a fifth of its size.
  const load = async () => {
    const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  };

  const draw = (id) => {
    const css = getComputedStyle(document.documentElement);
    const { data, layout } = resolved(figures[id], css);
    return Plotly.react(id, data, layout, config);
  };

  // One figure per task, so that a long report can be read while it is drawn.
  const drawAll = async () => {
    for (const id of Object.keys(figures)) {
      await draw(id);
      await new Promise((next) => setTimeout(next, 0));
    }
  };

  const now = () => Object.keys(figures).forEach(draw);
  const begin = async () => {
    if (!Object.keys(figures).length) return;
    if (typeof DecompressionStream === "undefined") {
      document.getElementById("old").hidden = false;
      return;
    }
    await load();
    drawAll();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
    addEventListener("beforeprint", () => {
      document.documentElement.dataset.theme = "light";
      now();
    });
    addEventListener("afterprint", () => {
      delete document.documentElement.dataset.theme;
      now();
    });
  };
  begin();
})();

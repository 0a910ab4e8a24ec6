// Tries what a reader does with the pictures of a report; appended to a page by check.py, which reads
// the findings from the element `checked`.
(async () => {
  const findings = [], facts = { figures: 0, panels: 0 };
  const expect = (what, holds) => { if (!holds) findings.push(what); };
  const frame = () => new Promise((done) => setTimeout(done, 60));
  const near = (a, b) => Math.abs(a - b) <= 1e-6 * Math.max(Math.abs(a), Math.abs(b), 1e-9);
  const range = (plot) => [plot.scales.x.min, plot.scales.x.max];
  const same = (a, b) => near(a[0], b[0]) && near(a[1], b[1]);

  const mouse = (target, type, plot, [x, y], more = {}) => {
    const box = plot.over.getBoundingClientRect();
    const place = { clientX: box.left + x * box.width, clientY: box.top + y * box.height };
    const moved = { movementX: 1, movementY: 1 };
    const common = { bubbles: true, cancelable: true, view: window };
    target.dispatchEvent(new MouseEvent(type, { ...common, ...moved, ...place, ...more }));
  };
  const drag = async (plot, from, to, more) => {
    mouse(plot.over, "mousemove", plot, from, more);
    mouse(plot.over, "mousedown", plot, from, more);
    mouse(document, "mousemove", plot, to, more);
    mouse(plot.over, "mousemove", plot, to, more);
    await frame();
    mouse(document, "mouseup", plot, to, more);
    await frame();
  };

  const group_of = async (name, group) => {
    const [plot] = group.plots, full = group.full;
    const together = (what) => expect(`${name}: ${what}: panels are apart`,
      group.plots.every((other) => same(range(other), range(plot))));
    expect(`${name}: does not begin with everything`, same(range(plot), full));
    const log = group.log ? Math.log10 : (v) => v;
    const share = (i) => log(full[0]) + i * (log(full[1]) - log(full[0]));
    await drag(plot, [0.3, 0.5], [0.6, 0.51]);
    together("dragged");
    const [low, high] = range(plot).map(log), pixel = (share(1) - share(0)) / plot.over.clientWidth;
    expect(`${name}: a drag from 30 to 60 % shows ${low} to ${high}`,
      Math.abs(low - share(0.3)) < 3 * pixel && Math.abs(high - share(0.6)) < 3 * pixel);
    await drag(plot, [0.5, 0.5], [0.25, 0.5], { shiftKey: true });
    together("moved");
    expect(`${name}: a drag with Shift does not move`, log(range(plot)[0]) > low);
    expect(`${name}: a drag with Shift stretches`,
      near(log(range(plot)[1]) - log(range(plot)[0]), high - low));
    const before = range(plot), box = plot.over.getBoundingClientRect();
    plot.over.dispatchEvent(new WheelEvent("wheel", {
      ctrlKey: true, deltaY: -1, cancelable: true, clientX: box.left + box.width / 2, clientY: box.top + 5,
    }));
    await frame();
    together("turned");
    expect(`${name}: the wheel does not enlarge`, range(plot)[1] - range(plot)[0] < before[1] - before[0]);
    mouse(plot.over, "dblclick", plot, [0.5, 0.5]);
    await frame();
    together("reset");
    expect(`${name}: a double click does not show all`, same(range(plot), full));
    const heights = [plot.scales.y.min, plot.scales.y.max];
    await drag(plot, [0.2, 0.2], [0.8, 0.7]);
    expect(`${name}: a drag across does not enlarge upwards`,
      plot.scales.y.max < heights[1] && plot.scales.y.min > heights[0]);
    group.all();
    await frame();
    expect(`${name}: heights are not what they were`, same([plot.scales.y.min, plot.scales.y.max], heights));
  };

  // Words beside and below a plot: no two are the same, none leaves the canvas or covers another.
  const words = (name, plot) => {
    for (const [place, axis] of plot.axes.entries()) {
      const said = (axis._values ?? []).map((word, i) => [word, axis._splits[i]]).filter(([word]) => word);
      const texts = said.map(([word]) => word);
      expect(`${name}: the same label twice: ${texts}`, new Set(texts).size === texts.length);
      plot.ctx.font = `${12 * uPlot.pxRatio}px system-ui, sans-serif`;
      const widths = texts.map((text) => plot.ctx.measureText(text).width / uPlot.pxRatio);
      if (place) {
        expect(`${name}: labels leave the page: ${texts}`, Math.max(0, ...widths) + 8 <= axis._size);
        expect(`${name}: a label runs along the axis`, !axis.label);
      }
      const middles = said.map(([, at]) => plot.valToPos(at, axis.scale));
      const sizes = place ? texts.map(() => 12) : widths;
      const order = middles.map((_, i) => i).sort((a, b) => middles[a] - middles[b]);
      order.slice(1).forEach((i, k) => {
        const before = order[k], gap = middles[i] - middles[before];
        expect(`${name}: ${texts[before]} and ${texts[i]} overlap`, gap >= 0.5 * (sizes[i] + sizes[before]));
      });
    }
  };

  // A focused panel obeys keys, and so does a focused name.
  const keyboard = async (name, plot, group) => {
    const press = async (target, key) => {
      target.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
      await frame();
    };
    expect(`${name}: a panel without a name or focus`,
      plot.root.tabIndex === 0 && plot.root.getAttribute("aria-label").length > 10);
    await press(plot.root, "+");
    const [low, high] = range(plot);
    expect(`${name}: plus does not enlarge`, !same([low, high], group.full));
    words(`${name}, enlarged`, plot);
    await press(plot.root, "ArrowRight");
    expect(`${name}: an arrow does not move`, range(plot)[0] > low && range(plot)[1] > high);
    // Where a small part is seen, labels have many digits.
    for (let i = 0; i < 12; i++) await press(plot.root, "+");
    words(`${name}, enlarged far`, plot);
    await press(plot.root, "0");
    expect(`${name}: 0 does not show all`, same(range(plot), group.full));
    const label = plot.root.parentElement.parentElement.querySelector(".u-series:not(.nameless) th[tabindex]");
    if (!label) return;
    await press(label, "Enter");
    expect(`${name}: Enter hides nothing`, plot.series.slice(1).some((of) => !of.show)
      && label.getAttribute("aria-pressed") === "false");
    await press(label, " ");
    expect(`${name}: Space shows nothing`, plot.series.slice(1).every((of) => of.show));
  };

  const panel = async (name, plot) => {
    // Of a curve that is there everywhere, as of time traces, the cursor shows a value.
    mouse(plot.over, "mouseenter", plot, [0.5, 0.5]);
    mouse(plot.over, "mousemove", plot, [0.5, 0.5]);
    await frame();
    const place = plot.root.parentElement.parentElement;
    const rows = [...place.querySelectorAll(".u-series:not(.nameless)")].slice(1);
    const values = rows.map((row) => row.querySelector(".u-value").textContent);
    const curves = plot.series.slice(1).some((of) => of.width > 0);
    if (curves && rows.length) {
      expect(`${name}: the cursor shows no value: ${values}`, values.some((text) => /\d/.test(text)));
    }
    if (rows.length) {
      rows[0].querySelector("th").click();
      await frame();
      expect(`${name}: a click on a name hides nothing`, plot.series.slice(1).some((of) => !of.show));
      rows[0].querySelector("th").click();
      await frame();
      expect(`${name}: a second click shows nothing`, plot.series.slice(1).every((of) => of.show));
    }
  };

  try {
    for (const figure of document.querySelectorAll("figure")) {
      if (!figure.querySelector("script")) continue;
      facts.figures += 1;
      const name = figure.parentElement.id;
      figure.scrollIntoView();
      for (let i = 0; i < 500 && !figure.classList.contains("live"); i++) await frame();
      expect(`${name}: is not built`, figure.classList.contains("live"));
      await frame();
      expect(`${name}: the static picture is still there`,
        getComputedStyle(figure.querySelector("svg")).display === "none");
      const { groups } = figure.querySelector(".zoom");
      for (const group of groups) {
        facts.panels += group.plots.length;
        if (group.plots.length) await group_of(name, group);
        for (const plot of group.plots) {
          words(name, plot);
          await panel(name, plot);
          await keyboard(name, plot, group);
        }
      }
      const button = [...figure.querySelectorAll("button")].find((b) => b.textContent === "+");
      button.click();
      await frame();
      const [group] = groups;
      if (group.plots.length) {
        expect(`${name}: the button does not enlarge`, !same(range(group.plots[0]), group.full));
        group.all();
      }
    }
    expect("something was loaded", performance.getEntriesByType("resource").length === 0);
  } catch (error) {
    findings.push(`${error}\n${error.stack}`);
  }
  const element = document.createElement("pre");
  element.id = "checked";
  element.textContent = JSON.stringify({ findings, facts });
  document.body.append(element);
})();

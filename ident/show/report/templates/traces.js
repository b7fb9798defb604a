// Torque and error over time: joint and run to choose, curves to hide, zoom by drag, buttons and keys. No library, no network.
(() => {
  const data = JSON.parse(document.getElementById("trace-data").textContent);
  const root = document.getElementById("trace-area");
  const live = root.querySelector(".trace-live");
  const plot = live.querySelector(".trace-plot");
  const values = live.querySelector(".trace-values");
  const choose = {};
  const hidden = new Set();
  const MARGIN = {left: 52, right: 8, top: 8, bottom: 34, between: 22};
  const SHARES = [0.6, 0.4];
  let range = null;
  let drag = null;

  const element = (name, attributes, parent, text) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  };
  const run = () => data.runs[choose.run.selectedIndex];
  const joint = () => data.joints[choose.joint.selectedIndex];
  const series = () => {
    const own = run().joints[choose.joint.selectedIndex];
    return own.values.map((steps) => steps.map((step) => (step === null ? null : own.low + step * own.step)));
  };
  const ends = () => [run().time[0], run().time[run().time.length - 1]];

  const ticks = (low, high, count) => {
    const rough = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const fits = (step) => Math.floor(high / step + 1e-9) - Math.ceil(low / step - 1e-9) + 1;
    const steps = [10, 5, 2, 1, 0.5, 0.2].map((one) => one * power);
    // The widest with enough ticks within the range, however it lies.
    const step = steps.find((one) => one <= 2 * rough && fits(one) >= Math.min(3, count)) || rough;
    const found = [];
    for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * step; at += step) found.push(at);
    const places = Math.max(0, -Math.floor(Math.log10(step)));
    return found.map((at) => [at, at.toFixed(places).replace("-", "−")]);
  };

  const path = (time, row, x, y, first, last) => {
    let text = "";
    let pen = "M";
    for (let k = first; k <= last; k += 1) {
      if (row[k] === null) { pen = "M"; continue; }
      text += `${pen}${x(time[k]).toFixed(1)} ${y(row[k]).toFixed(1)}`;
      pen = "L";
    }
    return text;
  };

  const draw = () => {
    const width = Math.max(plot.clientWidth, 260);
    const height = Math.min(520, Math.max(320, 0.5 * width));
    const rows = series();
    const time = run().time;
    const [low, high] = range || ends();
    const first = Math.max(0, time.findIndex((at) => at >= low) - 1);
    let last = time.findIndex((at) => at > high);
    last = last < 0 ? time.length - 1 : last;
    plot.textContent = "";
    const svg = element("svg", {viewBox: `0 0 ${width} ${height}`, width, height, "aria-hidden": "true"}, plot);
    const inner = height - MARGIN.top - MARGIN.bottom - MARGIN.between;
    const x = (at) => MARGIN.left + ((at - low) / (high - low)) * (width - MARGIN.left - MARGIN.right);
    let top = MARGIN.top;
    const panels = [
      {label: `${data.quantity} [${joint().unit}]`, rows: rows.map((row, k) => [k, row])},
      {label: `error [${joint().unit}]`, rows: rows.map((row, k) => [k, row.map((one, i) => (one === null ? null : rows[0][i] - one))]).slice(1)},
    ];
    panels.forEach((panel, number) => {
      const tall = inner * SHARES[number];
      const seen = panel.rows.filter(([k]) => !hidden.has(k));
      const inside = seen.flatMap(([, row]) => row.slice(first, last + 1)).filter((one) => one !== null);
      let bottom = Math.min(...inside, number ? 0 : Infinity);
      let most = Math.max(...inside, number ? 0 : -Infinity);
      if (!(most > bottom)) { bottom = (inside[0] || 0) - 1; most = bottom + 2; }
      const pad = 0.05 * (most - bottom);
      bottom -= pad;
      most += pad;
      const offset = top;
      const y = (one) => offset + ((most - one) / (most - bottom)) * tall;
      for (const [at, words] of ticks(bottom, most, 4)) {
        element("line", {x1: MARGIN.left, x2: width - MARGIN.right, y1: y(at), y2: y(at), class: "grid"}, svg);
        element("text", {x: MARGIN.left - 5, y: y(at) + 4, "text-anchor": "end"}, svg, words);
      }
      element("text", {x: 12, y: offset + tall / 2, transform: `rotate(-90 12 ${offset + tall / 2})`, "text-anchor": "middle"}, svg, panel.label);
      const clip = element("clipPath", {id: `trace-clip-${number}`}, svg);
      element("rect", {x: MARGIN.left, y: offset, width: width - MARGIN.left - MARGIN.right, height: tall}, clip);
      for (const [k, row] of seen) {
        element("path", {d: path(time, row, x, y, first, last), class: `curve curve-${k}`, "clip-path": `url(#trace-clip-${number})`}, svg);
      }
      top += tall + MARGIN.between;
    });
    for (const [at, words] of ticks(low, high, width < 500 ? 4 : 8)) {
      element("text", {x: x(at), y: height - MARGIN.bottom + 16, "text-anchor": "middle"}, svg, words);
    }
    element("text", {x: (MARGIN.left + width) / 2, y: height - 3, "text-anchor": "middle"}, svg, `time in ${run().name} [s]`);
    const mark = element("rect", {y: MARGIN.top, height: height - MARGIN.top - MARGIN.bottom, width: 0, class: "chosen"}, svg);
    const back = (event) => {
      const box = svg.getBoundingClientRect();
      const share = ((event.clientX - box.left) * width / box.width - MARGIN.left) / (width - MARGIN.left - MARGIN.right);
      return low + Math.min(1, Math.max(0, share)) * (high - low);
    };
    svg.onpointerdown = (event) => { drag = back(event); svg.setPointerCapture(event.pointerId); };
    svg.onpointermove = (event) => {
      const at = back(event);
      const near = time.findIndex((one) => one >= at);
      if (near >= 0) say(near, rows);
      if (drag === null) return;
      mark.setAttribute("x", x(Math.min(drag, at)));
      mark.setAttribute("width", Math.abs(x(at) - x(drag)));
    };
    svg.onpointerup = (event) => {
      const at = back(event);
      const chosen = [Math.min(drag, at), Math.max(drag, at)];
      drag = null;
      if (chosen[1] - chosen[0] > 0.01 * (high - low)) show(chosen);
      else mark.setAttribute("width", 0);
    };
    svg.ondblclick = () => show(null);
  };

  const say = (k, rows) => {
    const parts = data.curves.map((curve, i) => (hidden.has(i) || rows[i][k] === null ? "" : `${curve.label} ${rows[i][k].toPrecision(3).replace("-", "−")}`));
    values.textContent = `At ${run().time[k].toFixed(2)} s: ${parts.filter(Boolean).join(", ")} ${joint().unit}`;
  };

  const show = (wanted) => {
    const [first, last] = ends();
    range = wanted;
    if (range !== null) {
      const least = 10 * (last - first) / run().time.length;
      const size = Math.min(last - first, Math.max(least, range[1] - range[0]));
      const low = Math.min(Math.max(first, range[0]), last - size);
      range = size >= last - first ? null : [low, low + size];
    }
    draw();
  };

  const acts = {
    in: ([low, high]) => [low + 0.25 * (high - low), high - 0.25 * (high - low)],
    out: ([low, high]) => [low - 0.5 * (high - low), high + 0.5 * (high - low)],
    back: ([low, high]) => [low - 0.5 * (high - low), low + 0.5 * (high - low)],
    on: ([low, high]) => [low + 0.5 * (high - low), high + 0.5 * (high - low)],
    all: () => null,
  };
  const keys = {"+": "in", "=": "in", "-": "out", ArrowLeft: "back", ArrowRight: "on", Home: "all"};

  for (const select of live.querySelectorAll("select")) {
    choose[select.dataset.of] = select;
    const names = select.dataset.of === "joint" ? data.joints : data.runs;
    for (const one of names) select.add(new Option(one.name));
    select.onchange = () => show(select.dataset.of === "run" ? null : range);
  }
  for (const button of live.querySelectorAll("button")) {
    button.onclick = () => show(acts[button.dataset.do](range || ends()));
  }
  plot.onkeydown = (event) => {
    const act = keys[event.key];
    if (!act) return;
    event.preventDefault();
    show(acts[act](range || ends()));
  };
  const boxes = live.querySelector(".trace-curves");
  data.curves.forEach((curve, k) => {
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.onchange = () => { if (box.checked) hidden.delete(k); else hidden.add(k); draw(); };
    const swatch = document.createElement("span");
    swatch.className = `swatch swatch-${k}`;
    label.append(box, swatch, curve.label);
    boxes.append(label);
  });
  live.hidden = false;
  root.querySelector(".trace-static").hidden = true;
  window.addEventListener("resize", draw);
  window.addEventListener("beforeprint", draw);
  draw();
})();

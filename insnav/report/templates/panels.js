// Draws the panels and maps of a page with BokehJS. Drawings with equal `link` share a cursor; such panels also share the horizontal axis.
"use strict";
(() => {
const EDGE = 12, AXIS = 62; // widths beside the frame (the area inside the axes): on the right, and at least on the left [px]
const DARK = {"#0072B2": "#5AB0EE", "#000000": "#E8E8E8", "#D55E00": "#FF8A4C", "#009E73": "#35CDA0", "#8A8A8A": "#9A9A9A", "#56B4E9": "#B5E0FF"};
const RAMP = ["#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"];
const CLASSES = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#8A8A8A"];
const dark = matchMedia("(prefers-color-scheme: dark)"), print = matchMedia("print");
const links = new Map(); // by name of a link: full range of the horizontal axis, linked drawings, cursor position
let mode = "";

const words = JSON.parse(document.getElementById("words")?.textContent ?? "{}");
const say = text => { // translates a text into the language of the page; a unit in brackets stays unchanged
  if (words[text]) return words[text];
  const [name, ...unit] = text.split(" ["), number = /\d+(?:\.\d+)?/g, found = words[name.replace(number, "#")];
  return found ? [(name.match(number) ?? []).reduce((said, each) => said.replace("#", each), found), ...unit].join(" [") : text;
};
const floats = text => {
  const bytes = Uint8Array.from(atob(text), sign => sign.charCodeAt(0));
  return new Float32Array(bytes.buffer);
};
const style = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const shown = colour => (dark.matches && !print.matches && DARK[colour]) || colour;
const element = (tag, kind, parent, text = "") => {
  const made = document.createElement(tag);
  made.className = kind;
  made.textContent = text;
  parent.append(made);
  return made;
};
const short = value => {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return size >= 1e5 || (size < 1e-3 && size > 0) ? value.toExponential(2) : size >= 1000 ? value.toFixed(0) : value.toPrecision(3);
};
const extent = values => {
  let low = Infinity, high = -Infinity;
  for (const each of values) if (Number.isFinite(each)) { low = Math.min(low, each); high = Math.max(high, each); }
  return [low, high];
};
const decades = (start, end, most) => { // ticks of a logarithmic axis, at most `most`: 1, 2 and 5 times powers of ten, or powers of ten only
  const low = Math.floor(Math.log10(start)), high = Math.ceil(Math.log10(end)), every = Math.ceil((high - low) / most) || 1, ticks = [];
  const inside = value => value >= start * 0.999 && value <= end * 1.001;
  for (const steps of [[1, 2, 5], [1]]) {
    ticks.length = 0;
    for (let power = low; power <= high; power += steps.length > 1 ? 1 : every) for (const step of steps) ticks.push(Number(`${step}e${power}`));
    const seen = ticks.filter(inside);
    if (seen.length <= most && seen.length) return seen;
  }
  return ticks.filter(inside);
};
const unitOf = label => { const unit = /\[([^\]]*)\]\s*$/.exec(label)?.[1] ?? ""; return unit && unit !== "-" ? ` ${unit}` : ""; };
const plain = value => value >= 1e5 || value < 1e-4 ? value.toExponential(0) : String(value);
const nearest = (values, wanted) => { // index of the value nearest to `wanted`, in sorted values
  let a = 0, b = values.length - 1;
  while (b - a > 1) { const middle = (a + b) >> 1; if (values[middle] < wanted) a = middle; else b = middle; }
  return Math.abs(values[a] - wanted) <= Math.abs(values[b] - wanted) ? a : b;
};

class Drawing { // common base of panels and maps
  constructor(spec) {
    Object.assign(this, spec);
    this.root = document.getElementById(spec.key);
    this.place = this.root.querySelector(".plot");
    this.legend = this.root.querySelector(".legend");
    this.linked = null;
    if (spec.link) {
      if (!links.has(spec.link)) links.set(spec.link, {whole: [Infinity, -Infinity], members: [], at: NaN, busy: false});
      this.linked = links.get(spec.link);
      this.linked.members.push(this);
    }
    this.themed = []; // colours to set again when the theme changes: [model, property, colour]
  }
  base(label, options) {
    this.figure = Bokeh.Plotting.figure({
      height: this.height, sizing_mode: "stretch_width", toolbar_location: null, output_backend: "canvas",
      min_border_right: EDGE, min_border_left: AXIS, min_border_top: 6, outline_line_color: null, ...options,
    });
    this.figure.toolbar.autohide = true;
    element("p", "below", this.root, say(label)); // an HTML element, not a Bokeh axis label: Bokeh paints the ends of long labels twice
    this.paint(this.figure, "background_fill_color", "--paper");
    this.paint(this.figure, "border_fill_color", "--paper");
    for (const axis of [...this.figure.xaxis, ...this.figure.yaxis]) {
      for (const part of ["axis_label_text_color", "major_label_text_color", "axis_line_color", "major_tick_line_color"]) this.paint(axis, part, "--ink");
      axis.minor_tick_line_color = null;
      axis.axis_label_text_font_style = "normal";
      axis.axis_label_text_font_size = axis.major_label_text_font_size = "12px";
      axis.axis_label_standoff = 4;
      axis.formatter = new Bokeh.BasicTickFormatter({power_limit_low: -4, power_limit_high: 6});
    }
    for (const grid of [...this.figure.xgrid, ...this.figure.ygrid]) this.paint(grid, "grid_line_color", "--rule");
    return this.figure;
  }
  paint(model, property, colour) { this.themed.push([model, property, colour]); model[property] = colour.startsWith("--") ? style(colour) : shown(colour); }
  repaint() { for (const [model, property, colour] of this.themed) model[property] = colour.startsWith("--") ? style(colour) : shown(colour); }
  get frame() { // position and size of the area inside the axes, relative to the element [px]
    if (this.figure.properties.inner_width.is_unset) return {left: 0, top: 0, width: 0, height: 0};
    const width = this.figure.inner_width, height = this.figure.inner_height;
    return {left: this.figure.outer_width - width - EDGE, top: 6, width, height};
  }
  inside(event) {
    const box = this.place.getBoundingClientRect(), f = this.frame;
    const x = (event.clientX - box.left - f.left) / f.width, y = (event.clientY - box.top - f.top) / f.height;
    return x >= 0 && x <= 1 && y >= 0 && y <= 1 ? [x, y] : null;
  }
  async show() {
    this.view = await Bokeh.Plotting.show(this.figure, this.place);
    const canvas = this.place.querySelector(".bk-Figure")?.shadowRoot?.querySelector(".bk-Canvas")?.shadowRoot;
    const events = canvas?.querySelector(".bk-events");
    if (events) Object.assign(events.style, {touchAction: "pan-y", outline: "none"}); // vertical swipes scroll the page; no outline appears on click
    this.place.addEventListener("pointermove", event => { const at = this.inside(event); if (at) this.pointed(at); else this.left(); });
    this.place.addEventListener("pointerleave", event => { if (event.pointerType !== "touch") this.left(); });
  }
  left() { if (this.linked) follow(this.linked, NaN); else this.follow(NaN); } // called when the pointer leaves the frame
  pointed() {}
  follow() {}
  switched() {}
}

class Panel extends Drawing {
  draw() {
    for (const curve of this.curves) for (const key of ["x", "y", "low"]) if (curve[key] !== undefined) curve[key] = floats(curve[key]);
    const bars = this.curves.some(curve => curve.kind === "bars");
    const [low, high] = extent(this.curves.flatMap(curve => [...extent(curve.x), ...(bars && curve.low ? extent(curve.low) : [])]));
    const margin = 0.01 * (high - low || 1), factor = (high / low) ** 0.01;
    this.whole = this.logX ? [low / factor, high * factor] : [low - margin, high + margin];
    this.x = new Bokeh.Range1d({start: this.whole[0], end: this.whole[1]});
    if (this.linked) this.linked.whole = [Math.min(this.linked.whole[0], this.whole[0]), Math.max(this.linked.whole[1], this.whole[1])];
    const y = this.rows.length ? {start: this.rows.length - 0.4, end: -0.6} : {start: 0, end: 1};
    this.y = new Bokeh.Range1d(y);
    const figure = this.base(this.xLabel, {
      x_range: this.x, y_range: this.y, x_axis_type: this.logX ? "log" : "linear", y_axis_type: this.logY ? "log" : "linear",
      y_axis_label: say(this.yLabel).replace("[ug", "[µg"), tools: [new Bokeh.BoxZoomTool({dimensions: "width"})],
    });
    if (this.rows.length) {
      const axis = [...figure.yaxis][0];
      axis.ticker = [...figure.ygrid][0].ticker = new Bokeh.FixedTicker({ticks: this.rows.map((_, i) => i)});
      axis.major_label_overrides = new Map(this.rows.map((name, i) => [i, name]));
      if (this.linked) { // names of rows are drawn inside the frame, so that its left margin equals the margin of linked panels
        axis.visible = false;
        this.rows.forEach((text, i) => {
          const label = new Bokeh.Label({x: 4, x_units: "screen", y: i - 0.12, text, text_font_size: "12px", text_baseline: "bottom"});
          this.paint(label, "text_color", "--ink");
          figure.add_layout(label);
        });
      }
    }
    this.logs = [[this.logX, [...figure.xaxis][0], [...figure.xgrid][0], this.x], [this.logY, [...figure.yaxis][0], [...figure.ygrid][0], this.y]]
      .filter(([log]) => log).map(([, axis, grid, range]) => ({axis, range, ticker: axis.ticker = grid.ticker = new Bokeh.FixedTicker({ticks: []})}));
    for (const [start, end] of this.spans) {
      const box = new Bokeh.BoxAnnotation({left: start, right: end, fill_alpha: 0.3, line_color: null, level: "underlay"});
      this.paint(box, "fill_color", "#E69F00");
      figure.add_layout(box);
    }
    for (const [value, name] of this.levels) {
      const span = new Bokeh.Span({location: value, dimension: "width", line_dash: "dashed", line_width: 1});
      this.paint(span, "line_color", "#D55E00");
      figure.add_layout(span);
      this.entry(name, "#D55E00");
    }
    for (const curve of this.curves) this.glyph(figure, curve);
    if (this.spans.length && this.link) this.entry("no GPS used", "#E69F00").swatch.className = "band";
    const named = this.curves.filter(each => ["line", "dashed"].includes(each.kind) && each.text);
    named.forEach((curve, i) => { // names are placed at different horizontal positions, so that close lines do not cover them
      const row = Math.floor(curve.x.length * (i + 0.6) / (named.length + 0.2));
      const label = new Bokeh.Label({x: curve.x[row], y: curve.y[row], text: curve.text[0], text_font_size: "11px", text_font_style: "bold", text_align: ["left", "center", "right"][Math.round(2 * row / (curve.x.length - 1))], text_baseline: "bottom", y_offset: 3, background_fill_alpha: 0.75});
      this.paint(label, "text_color", curve.colour);
      this.paint(label, "background_fill_color", "--paper");
      figure.add_layout(label);
    });
    this.beyond = new Bokeh.ColumnDataSource({data: {x: [], y: [], a: [], c: []}});
    figure.scatter({field: "x"}, {field: "y"}, {source: this.beyond, marker: "triangle", angle: {field: "a"}, size: 7, line_color: null, fill_color: {field: "c"}});
    this.cursor = element("div", "cursor", this.place);
    this.stamp = element("span", "", this.cursor);
    this.units = [unitOf(this.xLabel), unitOf(this.yLabel).replace("ug", "µg")];
    this.tip = element("div", "tip", this.place);
    this.place.addEventListener("click", () => {
      if (!this.linked || !Number.isFinite(this.at)) return; // a click on an event zooms all linked panels to its time
      const half = 0.01 * (this.linked.whole[1] - this.linked.whole[0]);
      zoom(this.linked, this.at - half, this.at + half);
      follow(this.linked, this.at);
    });
    for (const side of ["start", "end"]) this.x.properties[side].change.connect(() => this.zoomed());
    figure.properties.inner_width.change.connect(() => { this.ticks(); level(); });
  }
  glyph(figure, curve) {
    const source = new Bokeh.ColumnDataSource({data: {x: curve.x, y: curve.y, ...(curve.low ? {low: curve.low} : {})}});
    const x = {field: "x"}, y = {field: "y"};
    const make = {
      line: () => figure.line(x, y, {source, line_width: 1.3}),
      dashed: () => figure.line(x, y, {source, line_width: 1.2, line_dash: [4, 3]}),
      thin: () => figure.line(x, y, {source, line_width: 0.6, line_alpha: 0.55}),
      points: () => figure.scatter(x, y, {source, ...(this.rows.length ? {size: 10, line_color: "white"} : {size: 3.5, line_color: null})}),
      crosses: () => figure.scatter(x, y, {source, size: 7, marker: "x", line_width: 1.5}),
      band: () => figure.varea({field: "x"}, {field: "low"}, {field: "y"}, {source, fill_alpha: 0.12}),
      bars: () => figure.hbar({y, left: {field: "low"}, right: x, height: 0.7, source, line_color: null}),
    };
    const made = make[curve.kind]();
    for (const part of ["band", "bars", "points"].includes(curve.kind) ? ["fill_color"] : ["line_color"]) this.paint(made.glyph, part, curve.colour);
    curve.renderer = made;
    if (curve.kind === "thin" && curve.text) { // the name of a thin line is written at its start
      const label = new Bokeh.Label({x: curve.x[0], y: curve.y[0], text: curve.text[0], text_font_size: "11px", text_align: "right", text_baseline: "middle"});
      this.paint(label, "text_color", curve.colour);
      figure.add_layout(label);
    }
    curve.entry = curve.name ? this.entry(curve.name, curve.colour, curve.kind) : {off: false, value: null};
    if (curve.name && !curve.entry.value && !this.rows.length && (curve.kind !== "points" || !curve.text) && ["line", "dashed", "points"].includes(curve.kind)) curve.entry.value = element("output", "", curve.entry.label);
  }
  entry(name, colour, kind = "") { // legend entry shared by all curves of a name; a click hides the curves, unless the entry has no kind
    this.entries ??= new Map();
    if (this.entries.has(name)) {
      const known = this.entries.get(name);
      if (known.swatch.className === "band") known.swatch.className = kind;
      return known;
    }
    const label = element("label", "", this.legend), swatch = element("i", kind || "dashed", label), entry = {label, swatch, off: false, value: null};
    swatch.dataset.colour = colour;
    swatch.style.setProperty("--swatch", shown(colour));
    element("span", "", label, say(name));
    if (kind) label.addEventListener("click", () => { entry.off = !entry.off; label.dataset.off = entry.off; this.switched(); });
    this.entries.set(name, entry);
    return entry;
  }
  repaint() {
    super.repaint();
    for (const swatch of this.legend.querySelectorAll("i")) swatch.style.setProperty("--swatch", shown(swatch.dataset.colour));
    this.fit();
  }
  visible(curve) { return !curve.entry.off && (!curve.mode || curve.mode === mode); }
  switched() {
    for (const curve of this.curves) curve.renderer.visible = this.visible(curve);
    for (const entry of this.entries?.values() ?? []) {
      const own = this.curves.filter(curve => curve.entry === entry);
      entry.label.hidden = own.length > 0 && !own.some(curve => !curve.mode || curve.mode === mode);
      entry.label.style.display = entry.label.hidden ? "none" : "";
    }
    this.fit();
    if (this.linked) this.follow(this.linked.at);
  }
  zoomed() {
    this.fit();
    if (!this.linked) return;
    zoom(this.linked, this.x.start, this.x.end);
    this.follow(this.linked.at);
  }
  ticks() {
    for (const {axis, range, ticker} of this.logs) {
      const ticks = decades(range.start, range.end, range === this.x ? Math.max(3, this.frame.width / 70) : Math.max(3, this.height / 28));
      axis.major_label_overrides = new Map(ticks.map(value => [value, plain(value)]));
      ticker.ticks = ticks;
    }
  }
  fit() { this.limit(); this.ticks(); }
  limit() { // sets the vertical axis: robust limits of all data, or after zooming the limits of the visible data
    if (this.rows.length) return;
    const [start, end] = [this.x.start, this.x.end], whole = this.linked?.whole ?? this.whole;
    const zoomed = start > whole[0] + 1e-6 * (whole[1] - whole[0]) || end < whole[1] - 1e-6 * (whole[1] - whole[0]);
    let limits = this.limits[mode] ?? Object.values(this.limits)[0] ?? [0, 1];
    if (zoomed) {
      let low = Infinity, high = -Infinity;
      for (const curve of this.curves.filter(each => this.visible(each))) {
        for (let i = 0; i < curve.x.length; i++) {
          if (curve.x[i] < start || curve.x[i] > end) continue;
          for (const value of [curve.y[i], curve.low?.[i]]) if (Number.isFinite(value) && !(this.logY && value <= 0)) { low = Math.min(low, value); high = Math.max(high, value); }
        }
      }
      if (low <= high) {
        const margin = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
        limits = this.logY ? [low / 1.3, high * 1.3] : [low - margin, high + margin];
      }
    }
    this.y.setv({start: limits[0], end: limits[1]});
    const marks = {x: [], y: [], a: [], c: []};
    for (const curve of this.curves.filter(each => this.visible(each) && !["band", "thin"].includes(each.kind))) {
      const outside = curve.y.filter(value => value > limits[1] || value < limits[0]).length;
      if (!["points", "crosses"].includes(curve.kind) && outside > Math.max(3, 0.05 * curve.y.length)) continue; // so many values are no outliers: the curve simply leaves the view, without marks at its edge
      for (let i = 0; i < curve.x.length && marks.x.length < 2000; i++) {
        const up = curve.y[i] > limits[1];
        if ((!up && !(curve.y[i] < limits[0])) || curve.x[i] < start || curve.x[i] > end) continue;
        marks.x.push(curve.x[i]); marks.y.push(limits[up ? 1 : 0]); marks.a.push(up ? 0 : Math.PI); marks.c.push(shown(curve.colour));
      }
    }
    const edges = this.curves.filter(each => each.kind === "band" && this.visible(each)).map(each => extent([...each.y, ...each.low].filter((_, i) => each.x[i % each.x.length] >= start && each.x[i % each.x.length] <= end)));
    const [lowest, highest] = extent(edges.flat());
    this.cut ??= element("span", "note", this.legend);
    this.cut.textContent = lowest < limits[0] || highest > limits[1] ? `${say("band cut")}: ${short(lowest)} … ${short(highest)}${this.units[1]}` : "";
    this.beyond.data = marks;
    this.root.dataset.outliers = marks.x.length;
  }
  pointed([x, y]) {
    const at = this.logX ? this.x.start * (this.x.end / this.x.start) ** x : this.x.start + x * (this.x.end - this.x.start);
    if (this.linked) follow(this.linked, at); else this.follow(at);
    this.hover(x, y);
  }
  left() { super.left(); this.tip.style.display = "none"; this.at = NaN; }
  hover(x, y) { // shows the text of the point or bar nearest to the pointer
    const f = this.frame;
    let best = null, distance = 14 ** 2;
    for (const curve of this.curves.filter(each => each.text && !["line", "dashed"].includes(each.kind) && this.visible(each))) {
      for (let i = 0; i < curve.x.length; i++) {
        const [px, py] = this.pixel(curve.x[i], curve.y[i]), bar = curve.kind === "bars";
        const left = bar ? this.pixel(curve.low[i], 0)[0] : px;
        const dx = Math.max(Math.min(left, px) - x * f.width, 0, x * f.width - Math.max(left, px)), d = dx ** 2 + (py - y * f.height) ** 2;
        if (d < distance) { distance = d; best = [px, py, curve.text[i], curve.x[i], bar ? this.rows[curve.y[i]] : null]; }
      }
    }
    this.tip.style.display = best ? "block" : "none";
    this.at = best && best[3];
    if (!best) return;
    this.tip.textContent = best[2];
    if (best[4]) emphasise(best[4]);
    Object.assign(this.tip.style, {left: `${Math.min(f.left + best[0] + 8, Math.max(0, f.left + f.width - this.tip.offsetWidth))}px`, top: `${f.top + best[1] + 10}px`});
  }
  pixel(x, y) { // converts data coordinates to a position in the frame [px]
    const share = (value, {start, end}, log) => log ? Math.log(value / start) / Math.log(end / start) : (value - start) / (end - start);
    return [this.frame.width * share(x, this.x, this.logX), this.frame.height * (1 - share(y, this.y, this.logY))];
  }
  follow(at) {
    const [x] = this.pixel(at, 1), f = this.frame, inside = x >= 0 && x <= f.width;
    Object.assign(this.cursor.style, {display: inside ? "block" : "none", left: `${f.left + x}px`, top: `${f.top}px`, height: `${f.height}px`});
    const decimals = Math.max(0, Math.ceil(-Math.log10((this.x.end - this.x.start) / f.width))); // resolution of one pixel
    this.stamp.textContent = inside ? (this.logX ? short(at) : at.toFixed(Math.min(decimals, 9))) + this.units[0] : "";
    this.stamp.style.transform = x > 0.7 * f.width ? "translateX(-100%)" : "";
    for (const curve of this.curves) {
      if (!this.visible(curve) || !curve.entry.value || !["line", "dashed", "points"].includes(curve.kind)) continue;
      curve.entry.value.textContent = inside ? short(curve.y[nearest(curve.x, at)]) + this.units[1] : "";
    }
  }
}

class Track extends Drawing {
  draw() {
    for (const key of ["east", "north", "time"]) this[key] = floats(this[key]);
    this.fixes = this.fixes.map(floats);
    for (const each of this.shades) each.values = floats(each.values);
    this.x = new Bokeh.Range1d({start: -1, end: 1});
    this.y = new Bokeh.Range1d({start: -1, end: 1});
    const figure = this.base("East of start [m]", {
      x_range: this.x, y_range: this.y, y_axis_label: say("North of start [m]"), min_border_left: AXIS + 14, // wide enough for coordinates of kilometres: if the margin grows later, Bokeh does not erase the old label completely
      tools: [new Bokeh.BoxZoomTool({match_aspect: true})],
    });
    const x = {field: "x"}, y = {field: "y"};
    for (const curve of this.behind) {
      for (const key of ["x", "y"]) curve[key] = floats(curve[key]);
      const source = new Bokeh.ColumnDataSource({data: {x: curve.x, y: curve.y}});
      const line = curve.kind === "crosses" ? figure.scatter(x, y, {source, size: 8, marker: "x", line_width: 2})
        : figure.line(x, y, {source, line_width: curve.kind === "thin" ? 1 : 3});
      this.paint(line.glyph, "line_color", curve.colour);
    }
    const fixes = figure.scatter(x, y, {source: new Bokeh.ColumnDataSource({data: {x: this.fixes[0], y: this.fixes[1]}}), size: 3, line_color: null});
    this.paint(fixes.glyph, "fill_color", "#8A8A8A");
    const lost = {xs: [], ys: []};
    for (const [start, end] of this.spans) {
      const rows = [...this.time.keys()].filter(i => this.time[i] >= start && this.time[i] <= end);
      lost.xs.push(rows.map(i => this.east[i])); lost.ys.push(rows.map(i => this.north[i]));
    }
    const wide = figure.multi_line({field: "xs"}, {field: "ys"}, {source: new Bokeh.ColumnDataSource({data: lost}), line_width: 11, line_alpha: 0.35});
    this.paint(wide.glyph, "line_color", "#E69F00");
    this.source = new Bokeh.ColumnDataSource({data: {x: this.east, y: this.north, c: Array(this.east.length).fill("#0072B2")}});
    figure.line(x, y, {source: this.source, line_color: "#8A8A8A", line_width: 1});
    figure.scatter(x, y, {source: this.source, size: 4.5, line_color: null, fill_color: {field: "c"}});
    const end = this.east.length - 1;
    for (const [row, marker, size, colour] of [[0, "triangle", 15, "#009E73"], [end, "square", 8, "#000000"]]) {
      const mark = figure.scatter([this.east[row]], [this.north[row]], {marker, size, line_color: "white"});
      this.paint(mark.glyph, "fill_color", colour);
    }
    this.here = element("div", "here", this.place);
    this.scale = element("div", "scale", this.place);
    element("span", "", this.scale);
    element("div", "compass", this.place, "N ↑").style.cssText = `right: ${EDGE + 8}px; top: 10px`;
    this.shade = 0;
    for (const range of [this.x, this.y]) range.properties.end.change.connect(() => this.measure());
    for (const side of ["inner_width", "inner_height"]) figure.properties[side].change.connect(() => { if (!this.touched) this.all(); });
  }
  all() { // shows the whole map with equal scales of both axes
    const {width, height} = this.frame, wide = this.behind.filter(each => each.kind === "line");
    const [west, east] = extent([...this.east, ...wide.flatMap(each => [...each.x])]), [south, north] = extent([...this.north, ...wide.flatMap(each => [...each.y])]);
    if (!(width > 0 && height > 0)) return;
    const metres = 1.12 * Math.max((east - west) / width, (north - south) / height, 4 / width);
    this.metres = metres;
    this.x.setv({start: (west + east - metres * width) / 2, end: (west + east + metres * width) / 2});
    this.y.setv({start: (south + north - metres * height) / 2, end: (south + north + metres * height) / 2});
    this.measure();
  }
  measure() { // updates the scale bar, whose length is 1, 2 or 5 times a power of ten
    const {left, top, width, height} = this.frame, metre = width / (this.x.end - this.x.start);
    const most = 0.25 * width / metre, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map(step => step * power).find(each => each <= most);
    if (!(length > 0)) return;
    Object.assign(this.scale.style, {left: `${left + 14}px`, top: `${top + height - 22}px`, width: `${length * metre}px`});
    this.scale.firstChild.textContent = length >= 1000 ? `${length / 1000} km` : `${length} m`;
    if (this.linked) this.follow(this.linked.at);
  }
  async show() { await super.show(); this.all(); }
  switched() {
    this.legend.replaceChildren();
    const shades = this.shades.filter(each => !each.mode || each.mode === mode);
    this.shade = Math.min(this.shade, shades.length - 1);
    shades.forEach((each, i) => {
      const button = element("button", "", this.legend, say(each.name));
      button.type = "button";
      button.setAttribute("aria-pressed", i === this.shade);
      button.addEventListener("click", () => { this.shade = i; this.switched(); });
    });
    if (shades.length) this.colour(shades[this.shade]);
    const key = (colour, text) => { const label = element("label", "", this.legend); element("i", "", label).style.setProperty("--swatch", shown(colour)); element("span", "", label, say(text)); };
    key("#009E73", "start"); key("#000000", "end");
    for (const [name, colour] of new Map(this.behind.filter(each => each.name).map(each => [each.name, each.colour]))) key(colour, name);
    if (this.fixes[0].length) key("#8A8A8A", "GPS fix");
    if (this.spans.length) key("#E69F00", "no GPS used");
  }
  colour(shade) {
    const given = new Map(shade.classes.map(([value, name], i) => [value, [CLASSES[i % CLASSES.length], name]]));
    let colours;
    if (given.size) {
      colours = [...shade.values].map(value => given.get(value)?.[0] ?? "#8A8A8A");
      for (const [colour, name] of given.values()) { const label = element("label", "", this.legend); element("i", "", label).style.setProperty("--swatch", colour); element("span", "", label, say(name)); }
    } else {
      const sorted = [...shade.values].filter(Number.isFinite).sort((a, b) => a - b);
      const low = sorted[Math.floor(0.02 * (sorted.length - 1))], high = sorted[Math.ceil(0.98 * (sorted.length - 1))];
      colours = [...shade.values].map(value => Number.isFinite(value) ? RAMP[Math.round(10 * Math.min(1, Math.max(0, (value - low) / (high - low || 1))))] : "#8A8A8A");
      const label = element("label", "", this.legend);
      element("span", "", label, short(low));
      element("i", "ramp", label).style.background = `linear-gradient(90deg, ${RAMP.join(",")})`;
      element("span", "", label, `${short(high)}`);
    }
    this.source.data = {...this.source.data, c: colours};
  }
  pointed([x, y]) {
    const east = this.x.start + x * (this.x.end - this.x.start), north = this.y.end - y * (this.y.end - this.y.start);
    let best = 0, distance = Infinity;
    for (let i = 0; i < this.time.length; i++) {
      const d = (this.east[i] - east) ** 2 + (this.north[i] - north) ** 2;
      if (d < distance) { distance = d; best = i; }
    }
    if (this.linked) follow(this.linked, this.time[best]);
  }
  follow(at) {
    const row = nearest(this.time, at), f = this.frame;
    const x = (this.east[row] - this.x.start) / (this.x.end - this.x.start), y = (this.y.end - this.north[row]) / (this.y.end - this.y.start);
    const inside = Number.isFinite(at) && x >= 0 && x <= 1 && y >= 0 && y <= 1;
    Object.assign(this.here.style, {display: inside ? "block" : "none", left: `${f.left + x * f.width}px`, top: `${f.top + y * f.height}px`});
  }
  repaint() { super.repaint(); this.switched(); }
}

const emphasise = name => { // draws the curve that has the name of the hovered bar with a thick line
  for (const each of globalThis.insnav?.drawings ?? []) {
    for (const curve of each.curves ?? []) if (curve.kind === "line") curve.renderer.glyph.line_width = curve.name === name ? 4 : 1.3;
  }
};
const follow = (link, at) => { link.at = at; for (const each of link.members) each.follow(at); };
const zoom = (link, start, end) => {
  if (link.busy || !(end > start)) return;
  link.busy = true;
  for (const each of link.members) if (each instanceof Panel) each.x.setv({start, end});
  link.busy = false;
};
let levelling = 0, complete = false;
const level = () => { // gives linked panels equal left margins, so that their cursors are aligned vertically
  if (!complete) return;
  cancelAnimationFrame(levelling);
  levelling = requestAnimationFrame(() => {
    for (const link of links.values()) {
      const own = link.members.filter(each => each instanceof Panel && each.frame.width > 0), left = Math.ceil(Math.max(...own.map(each => each.frame.left)));
      for (const each of own) if (each.figure.min_border_left !== left) each.figure.min_border_left = left;
    }
  });
};
const whole = drawing => {
  const link = drawing.linked;
  if (link) zoom(link, ...link.whole);
  if (drawing instanceof Track) { drawing.touched = false; drawing.all(); } else if (!link) drawing.x.setv({start: drawing.whole[0], end: drawing.whole[1]});
};

for (const line of document.querySelectorAll(".command")) {
  const button = element("button", "", line, say("copy"));
  button.type = "button";
  button.addEventListener("click", () => {
    const code = line.querySelector("code");
    getSelection().selectAllChildren(code); // if the browser forbids pages to copy, the user can copy the selected text
    button.textContent = document.execCommand("copy") ? say("copied") : say("selected");
  });
}

(async () => {
  Bokeh.logger.set_level("off"); // no log messages in the browser console
  const specs = JSON.parse(document.getElementById("panels-data").textContent);
  const drawings = specs.map(spec => new (spec.curves ? Panel : Track)(spec));
  const choose = chosen => {
    mode = chosen;
    for (const button of document.querySelectorAll(".switch button")) button.setAttribute("aria-pressed", button.dataset.mode === mode);
    for (const each of document.querySelectorAll("[data-of]")) each.hidden = each.dataset.of !== mode;
    for (const each of drawings) each.switched();
  };
  const repaint = () => { for (const each of drawings) each.repaint(); };
  for (const each of drawings) each.draw();
  for (const link of links.values()) zoom(link, ...link.whole);
  for (const button of document.querySelectorAll(".switch button")) button.addEventListener("click", () => choose(button.dataset.mode));
  choose(specs.flatMap(spec => spec.curves ?? spec.shades).find(each => each.mode)?.mode ?? "");
  for (const each of drawings) {
    if (!document.body.dataset.seen && each.root.getBoundingClientRect().top > innerHeight) document.body.dataset.seen = Math.round(performance.now());
    await each.show();
    await new Promise(done => setTimeout(done)); // gives the browser time to handle user input between drawings
    each.place.addEventListener("dblclick", () => whole(each));
  }
  complete = true;
  level();
  for (const media of [dark, print]) media.addEventListener("change", repaint);
  globalThis.insnav = {drawings, links, follow, zoom, whole}; // access for tests and for debugging
  document.body.dataset.drawn = Math.round(performance.now());
})();
})();

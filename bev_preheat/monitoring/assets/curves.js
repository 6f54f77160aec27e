// SPDX-License-Identifier: Apache-2.0
/*
Stacked curves over one time axis, drawn by uPlot, which must be loaded first. curves.css is their style.

  const curves = bevCurves.create(element, {
    rows: [{
      title: 'Temperature', unit: '°C',
      height: 220,                       // [px]; optional
      least: 0, most: 1,                 // limits that the axis always shows; optional
      noScale: true,                     // no figures at the axis: states
      leastSpan: 2,                      // the axis spans at least this much; optional
      series: [{
        name: 'prediction', key: 'predicted',  // the column in the data
        short: 'forecast',               // the name in the legend of a narrow screen; optional
        colour: 'blue',                  // ink, blue, vermillion, green, orange, purple, grey
        dash: 'dash',                    // solid, dash, dot, dashdot, long
        width: 2, digits: 1, scale: 1,   // line [px]; decimals of the legend; factor from data to unit
        step: true,                      // holds each value until the next: heater, states
        low: 'low', high: 'high',        // columns of a band around it; the legend shows them
        onto: 'below', own: 'part',      // part of a stack: filled down to this column ('': 0); the legend shows `own`
        times: 'planTime',               // column of its instants, if not `time`
        words: ['off', 'on'],            // the legend shows the word of a value 0, 1, …
        constant: true,                  // the legend shows its last value, wherever the cursor is
        off: true,                       // hidden until its legend entry is pressed
      }],
    }],
    data: {time: [...], predicted: [...]},  // arrays or typed arrays; time ascends, in s since 1970; null or NaN: none
    markers: [{at: 1.7e9, text: 'HEATING'}],  // vertical lines at instants [s], with a text
    // periods, a strip in the first row; with `row` the whole height of that row; optional
    shades: [{from: 1.7e9, to: null, text: 'charging', colour: 'green', row: 1}],
    endText: 'end',                    // what the readout calls the last instant; optional
    clock: 'utc',                        // utc, local, or seconds (data.time in s from the start)
    onPick: (at) => {},                  // a click or Enter at an instant [s]; optional
  });

  curves.setData(data)       replaces all columns; the zoom stays
  curves.merge(columns)      replaces some columns, such as those of a chosen plan
  curves.setMarkers(list)    replaces the vertical lines
  curves.setShades(list)     replaces the periods
  curves.pick(at, text)      draws a line at an instant [s] that stays, with a text; null: none

Drag selects a period to zoom into, a double click shows all. Two fingers zoom on a touch screen. With the keyboard:
arrows move the cursor, + and - zoom, 0 shows all, Enter picks. Colours are those of Okabe and Ito, with dashes; they
follow prefers-color-scheme, or the attribute data-theme="light" or "dark" of the html element.
*/
const bevCurves = (() => {
  'use strict';
  const COLOURS = {
    ink: ['#000000', '#f0f0f0'], blue: ['#0072b2', '#56b4e9'], vermillion: ['#d55e00', '#ef7d2a'],
    green: ['#00795a', '#00b386'], orange: ['#b87f00', '#e69f00'], purple: ['#b0568a', '#dc94bd'],
    grey: ['#6a6a6a', '#9a9a9a']};
  const DASHES = {solid: [], dash: [8, 4], dot: [2, 3], dashdot: [9, 3, 2, 3], long: [15, 5]};
  const AXIS_WIDTH = 54, DEFAULT_HEIGHT = 170, X_AXIS_HEIGHT = 34, MARKER_HEIGHT = 18, SHADE_HEIGHT = 18;
  const darkScheme = matchMedia('(prefers-color-scheme: dark)');

  function isDark() {
    const theme = document.documentElement.dataset.theme;
    return theme ? theme === 'dark' : darkScheme.matches;
  }
  const colourOf = (name) => (COLOURS[name] || COLOURS.ink)[isDark() ? 1 : 0];
  const two = (number) => String(number).padStart(2, '0');
  const isNumber = (value) => value !== null && value !== undefined && !Number.isNaN(value);

  function element(tag, className, parent, text) {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text) made.textContent = text;
    if (parent) parent.append(made);
    return made;
  }

  // Index of the last time that is not after `at`; -1: none.
  function lastUntil(times, at) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= at) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  // Plain array of a column in its unit; what is not a number is a gap.
  function plain(column, factor, length) {
    const made = new Array(length);
    for (let index = 0; index < length; index++) {
      const value = column ? column[index] : null;
      made[index] = isNumber(value) ? (factor === 1 ? value : value * factor) : null;
    }
    return made;
  }

  function clockText(at, clock, withDate) {
    if (clock === 'seconds') {
      const whole = Math.abs(Math.round(at)), sign = at < -0.5 ? '-' : '';
      return `${sign}${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
    }
    const date = new Date(Math.round(at) * 1000);
    const [year, month, day, hour, minute, second] = clock === 'local'
      ? [date.getFullYear(), date.getMonth(), date.getDate(), date.getHours(), date.getMinutes(), date.getSeconds()]
      : [date.getUTCFullYear(), date.getUTCMonth(), date.getUTCDate(), date.getUTCHours(), date.getUTCMinutes(),
        date.getUTCSeconds()];
    const time = `${two(hour)}:${two(minute)}:${two(second)}`;
    return withDate ? `${year}-${two(month + 1)}-${two(day)} ${time}${clock === 'local' ? '' : ' UTC'}` : time;
  }

  class Curves {
    constructor(parent, options) {
      this.options = Object.assign({clock: 'utc', endText: 'end', onPick: () => {}}, options);
      this.markers = (options.markers || []).slice();
      this.shades = (options.shades || []).slice();
      this.data = options.data;
      this.picked = this.at = null;
      this.pickedText = '';
      this.plots = [];
      this.range = null;
      this.key = `bev${Math.random()}`;
      this.root = element('div', 'bev-curves', parent);
      this.root.tabIndex = 0;
      this.root.setAttribute('role', 'group');
      this.root.setAttribute('aria-label',
        'Curves. Arrows move the cursor, plus and minus zoom, 0 shows all, Enter picks an instant.');
      const head = element('div', 'bev-head', this.root);
      this.readout = element('output', 'bev-readout', head);
      const buttons = element('span', 'bev-buttons', head);
      for (const [text, label, action] of [['−', 'zoom out', () => this.magnify(2)],
        ['+', 'zoom in', () => this.magnify(0.5)], ['all', 'show all', () => this.reset()]]) {
        const button = element('button', '', buttons, text);
        button.type = 'button';
        button.title = label;
        button.setAttribute('aria-label', label);
        button.addEventListener('click', action);
      }
      this.body = element('div', 'bev-rows', this.root);
      this.root.addEventListener('keydown', (event) => this.onKey(event));
      this.redraw = () => this.recolour();
      darkScheme.addEventListener('change', this.redraw);
      new MutationObserver(this.redraw).observe(document.documentElement, {attributes: true, attributeFilter: ['data-theme']});
      this.rows = options.rows;
      this.plots = this.rows.map((row, index) => this.makeRow(row, index, index === this.rows.length - 1));
      this.reset();
      this.tell();
      new ResizeObserver(() => this.fit()).observe(this.body);
    }

    setData(data) {
      this.data = data;
      for (const row of this.plots) this.refresh(row);
      this.tell();
    }

    merge(columns) {
      Object.assign(this.data, columns);
      for (const row of this.plots) {
        if (row.keys.some((key) => key in columns)) this.refresh(row);
      }
      this.tell();
    }

    setMarkers(markers) {
      this.markers = markers.slice();
      for (const row of this.plots) row.plot.redraw(false);
      this.tell();
    }

    setShades(shades) {
      this.shades = shades.slice();
      for (const row of this.plots) row.plot.redraw(false);
    }

    pick(at, text = '') {
      this.picked = at;
      this.pickedText = text;
      for (const row of this.plots) row.plot.redraw(false);
    }

    reset() {
      this.range = null;
      const [from, to] = this.whole();
      this.show(from, to, true);
    }

    // The first and the last instant of all columns [s].
    whole() {
      let from = Infinity, to = -Infinity;
      for (const row of this.plots) {
        const times = row.plot.data[0];
        if (times.length) { from = Math.min(from, times[0]); to = Math.max(to, times[times.length - 1]); }
      }
      return from < to ? [from, to] : from === to ? [from - 1, to + 1] : [0, 1];
    }

    shown() { return this.range || this.whole(); }

    show(from, to, all = false) {
      if (!(to > from)) return;
      this.range = all ? null : [from, to];
      this.zooming = true;
      for (const row of this.plots) row.plot.setScale('x', {min: from, max: to});
      this.zooming = false;
      // The cursor stays where it is on the screen.
      const left = this.plots.length ? this.plots[0].plot.cursor.left : -1;
      if (this.at !== null && left >= 0) this.setCursor(this.plots[0].plot.posToVal(left, 'x'));
    }

    magnify(factor) {
      const [from, to] = this.shown(), [first, last] = this.whole();
      const middle = this.at !== null && this.at >= from && this.at <= to ? this.at : (from + to) / 2;
      const [low, high] = [middle - (middle - from) * factor, middle + (to - middle) * factor];
      if (low <= first && high >= last) this.reset(); else if (high - low >= 1) this.show(low, high);
    }

    onKey(event) {
      const [from, to] = this.shown(), step = (to - from) / (event.shiftKey ? 10 : 60);
      const at = this.at === null ? (from + to) / 2 : this.at;
      const actions = {
        ArrowLeft: () => this.moveTo(at - step), ArrowRight: () => this.moveTo(at + step),
        Home: () => this.moveTo(from), End: () => this.moveTo(to),
        '+': () => this.magnify(0.5), '=': () => this.magnify(0.5), '-': () => this.magnify(2),
        0: () => this.reset(), Escape: () => this.reset(), Enter: () => this.options.onPick(at)};
      // The buttons and the legend have keys of their own.
      if (event.target !== this.root || event.ctrlKey || event.metaKey || event.altKey || !actions[event.key]) return;
      actions[event.key]();
      event.preventDefault();
    }

    moveTo(at) {
      const [from, to] = this.shown(), held = Math.min(Math.max(at, from), to);
      for (const row of this.plots) row.plot.setCursor({left: row.plot.valToPos(held, 'x'), top: 10}, false);
      this.setCursor(held);
    }

    setCursor(at) {
      this.at = at;
      if (!this.waits) {
        this.waits = true;
        requestAnimationFrame(() => { this.waits = false; this.tell(); });
      }
    }

    makeRow(definition, index, isLast) {
      const box = element('section', 'bev-row', this.body);
      box.setAttribute('aria-label', `${definition.title}${definition.unit ? ` in ${definition.unit}` : ''}`);
      const caption = element('div', 'bev-caption', box);
      element('strong', '', caption,
        definition.unit ? `${definition.title} [${definition.unit}]` : definition.title);
      const legend = element('span', 'bev-legend', caption), chart = element('div', 'bev-chart', box);
      const row = {definition, index, legend: [], height: definition.height || DEFAULT_HEIGHT, hasMarkers: index === 0,
        isLast};
      const lines = [{}], bands = [];
      row.columns = [];
      row.keys = [];
      row.places = new Map();
      for (const series of definition.series) {
        const show = !series.off, main = lines.length;
        lines.push({
          label: series.name, scale: 'y', show, width: series.width || 2, stroke: () => colourOf(series.colour),
          dash: DASHES[series.dash || 'solid'], points: {show: false},
          fill: series.onto === '' ? () => `${colourOf(series.colour)}44` : undefined,
          paths: series.step ? uPlot.paths.stepped({align: 1}) : undefined});
        row.columns.push([series, series.key]);
        row.keys.push(series.key, series.times || 'time');
        const indices = [main];
        if (series.onto) bands.push({series: [main, row.places.get(series.onto)], fill: () => `${colourOf(series.colour)}44`});
        row.places.set(series.key, main);
        if (series.low && series.high) {
          for (const key of [series.high, series.low]) {
            indices.push(lines.length);
            lines.push({label: key, scale: 'y', show, width: 0, stroke: 'transparent', points: {show: false}});
            row.columns.push([series, key]);
            row.keys.push(key);
          }
          bands.push({series: [main + 1, main + 2], fill: () => `${colourOf(series.colour)}33`});
        }
        row.legend.push(this.makeLegend(legend, row, series, indices));
      }
      const ink = () => getComputedStyle(this.root).color;
      const grid = {stroke: () => (isDark() ? '#ffffff22' : '#00000018'), width: 1};
      row.plot = new uPlot({
        width: this.width(), height: this.heightOf(row), legend: {show: false}, series: lines, bands,
        padding: [row.hasMarkers ? MARKER_HEIGHT : 6, 26, isLast ? 0 : 4, 0],
        scales: {x: {time: false}, y: {range: (plot, low, high) => yRange(definition, low, high)}},
        axes: [
          {stroke: ink, grid, ticks: grid, size: isLast ? X_AXIS_HEIGHT : 0, space: 74,
            incrs: [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800,
              604800],
            values: (plot, splits) => splits.map((at) => (isLast ? clockText(at, this.options.clock) : ''))},
          {stroke: ink, grid, ticks: grid, size: AXIS_WIDTH, space: 28,
            values: definition.noScale ? (plot, splits) => splits.map(() => '') : undefined}],
        cursor: {
          sync: {key: this.key, filters: {pub: (type) => type === 'mousemove' || type === 'mouseleave'}},
          focus: {prox: -1}, drag: {x: true, y: false, dist: 4}, points: {size: 7}},
        hooks: {
          setCursor: [(plot) => this.onCursor(plot)],
          setScale: [(plot, key) => this.onScale(plot, key)],
          draw: [(plot) => this.drawShades(plot, row), (plot) => this.drawMarkers(plot, row)]},
      }, this.tableOf(row), chart);
      this.listen(row);
      return row;
    }

    makeLegend(parent, row, series, indices) {
      const button = element('button', 'bev-entry', parent), value = element('span', 'bev-value');
      button.type = 'button';
      button.title = `show or hide ${series.name}`;
      button.setAttribute('aria-pressed', String(!series.off));
      const sample = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
      sample.setAttribute('width', '28');
      sample.setAttribute('height', '8');
      sample.setAttribute('aria-hidden', 'true');
      const line = document.createElementNS('http://www.w3.org/2000/svg', 'line');
      for (const [name, number] of [['x1', 0], ['x2', 28], ['y1', 4], ['y2', 4], ['stroke-width', series.width || 2]]) {
        line.setAttribute(name, String(number));
      }
      line.setAttribute('stroke', colourOf(series.colour));
      line.setAttribute('stroke-dasharray', DASHES[series.dash || 'solid'].join(' ') || 'none');
      sample.append(line);
      const name = element('span', series.short ? 'bev-long' : '', button, series.name);
      button.append(sample, ' ', name);
      if (series.short) button.append(element('span', 'bev-short', null, series.short));
      button.append(' ', value);
      button.addEventListener('click', () => {
        const show = button.getAttribute('aria-pressed') !== 'true';
        button.setAttribute('aria-pressed', String(show));
        for (const index of indices) row.plot.setSeries(index, {show});
      });
      return {series, value, line};
    }

    tableOf(row) {
      const tables = new Map();
      for (const [series, key] of row.columns) {
        const times = this.data[series.times || 'time'] || [];
        if (!tables.has(times)) tables.set(times, [Array.from(times)]);
        tables.get(times).push(plain(this.data[key], series.scale || 1, times.length));
      }
      // A plot has one column of times; in the order of its series again.
      const sources = [...tables.keys()], joined = sources.length === 1 ? tables.get(sources[0])
        : merged([...tables.values()]);
      const offsets = new Map();
      let offset = 1;
      for (const source of sources) { offsets.set(source, offset); offset += tables.get(source).length - 1; }
      const table = [joined[0]];
      for (const [series] of row.columns) {
        const times = this.data[series.times || 'time'] || [];
        const source = sources.find((each) => each === times) || sources.find((each) => !each.length && !times.length);
        const at = offsets.get(source);
        offsets.set(source, at + 1);
        table.push(joined[at]);
      }
      return table;
    }

    refresh(row) {
      row.plot.setData(this.tableOf(row), false);
      const [from, to] = this.shown();
      this.zooming = true;
      row.plot.setScale('x', {min: from, max: to});
      this.zooming = false;
    }

    onScale(plot, key) {
      if (key !== 'x' || this.zooming) return;
      const {min, max} = plot.scales.x, [from, to] = this.whole();
      if (min <= from && max >= to) this.reset(); else this.show(min, max);
    }

    onCursor(plot) {
      if (this.zooming) return;
      const {left} = plot.cursor;
      const at = left === undefined || left < 0 ? null : plot.posToVal(left, 'x');
      if (at !== this.at) this.setCursor(at);
    }

    // Readout and legends at the cursor; without one at the end.
    tell() {
      const end = this.data.time && this.data.time.length ? this.data.time[this.data.time.length - 1] : null;
      const at = this.at === null ? end : this.at;
      const instants = this.markers.map((each) => each.at), marker = at === null ? -1 : lastUntil(instants, at);
      this.readout.textContent = at === null ? 'no data' : `${clockText(at, this.options.clock, true)}${
        this.at === null ? ` (${this.options.endText})` : ''}${marker < 0 ? '' : ` · ${this.markers[marker].text}`}`;
      for (const row of this.plots) {
        for (const {series, value} of row.legend) value.textContent = this.valueText(row.definition, series, at);
      }
    }

    valueText(definition, series, at) {
      const times = this.data[series.times || 'time'], column = this.data[series.own || series.key];
      if (!times || !column || at === null || !times.length) return '–';
      if (!series.constant && at > times[times.length - 1] + 2) return '–';
      const index = series.constant ? times.length - 1 : lastUntil(times, at);
      if (index < 0 || !isNumber(column[index])) return '–';
      const factor = series.scale || 1, digits = series.digits === undefined ? 1 : series.digits;
      if (series.words) return series.words[column[index]] || '–';
      const low = series.low && this.data[series.low], high = series.high && this.data[series.high];
      const spread = low && high && isNumber(low[index]) && isNumber(high[index])
        ? ` ±${((high[index] - low[index]) / 2 * factor).toFixed(digits)}` : '';
      const unit = definition.unit ? ` ${definition.unit}` : '';
      return `${(column[index] * factor).toFixed(digits)}${spread}${unit}`;
    }

    drawMarkers(plot, row) {
      const {ctx, bbox} = plot, ratio = uPlot.pxRatio, [from, to] = [plot.scales.x.min, plot.scales.x.max];
      ctx.save();
      ctx.lineWidth = ratio;
      ctx.strokeStyle = ctx.fillStyle = colourOf('grey');
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = 'bottom';
      ctx.textAlign = 'left';
      const shown = this.markers.filter((each) => each.at <= to);
      let free = -Infinity;
      shown.forEach((marker, index) => {
        const next = shown[index + 1];
        // The state that holds at the left edge is named too.
        const isBefore = marker.at < from;
        if (isBefore && next && next.at <= from) return;  // it does not hold at the edge any more
        const x = isBefore ? bbox.left : plot.valToPos(marker.at, 'x', true);
        if (!isBefore) {
          ctx.setLineDash([2 * ratio, 3 * ratio]);
          line(ctx, x, bbox);
        }
        if (!row.hasMarkers || x < free) return;
        const end = next ? plot.valToPos(next.at, 'x', true) : bbox.left + bbox.width;
        const text = fitted(ctx, marker.text, end - x - 6 * ratio);
        if (!text) return;
        ctx.fillText(text, x + 2 * ratio, bbox.top - 3 * ratio);
        free = x + ctx.measureText(text).width + 6 * ratio;
      });
      if (this.picked !== null && this.picked >= from && this.picked <= to) {
        ctx.setLineDash([]);
        ctx.lineWidth = 2 * ratio;
        ctx.strokeStyle = colourOf('vermillion');
        const x = plot.valToPos(this.picked, 'x', true);
        line(ctx, x, bbox);
        if (row.isLast && this.pickedText) {
          const width = ctx.measureText(this.pickedText).width, isRight = x + width + 10 * ratio > bbox.left + bbox.width;
          ctx.fillStyle = ctx.strokeStyle;
          ctx.textBaseline = 'top';
          ctx.fillText(this.pickedText, isRight ? x - width - 5 * ratio : x + 5 * ratio, bbox.top + 3 * ratio);
        }
      }
      ctx.restore();
    }

    // A strip along the bottom of the first row, or a whole row, hatched so that it needs no colour.
    drawShades(plot, row) {
      const shades = this.shades.filter((shade) => (shade.row || 0) === row.index);
      if (!shades.length) return;
      const {ctx, bbox} = plot, ratio = uPlot.pxRatio, {min, max} = plot.scales.x;
      const height = row.index ? bbox.height : SHADE_HEIGHT * ratio;
      const top = bbox.top + bbox.height - height, right = bbox.left + bbox.width;
      ctx.save();
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = 'middle';
      for (const {from, to, text, colour} of shades) {
        if (from >= max || (to !== null && to <= min)) continue;
        const left = Math.max(plot.valToPos(from, 'x', true), bbox.left);
        const end = Math.min(to === null ? right : plot.valToPos(to, 'x', true), right);
        ctx.save();
        ctx.beginPath();
        ctx.rect(left, top, Math.max(end - left, 2 * ratio), height);
        ctx.fillStyle = `${colourOf(colour)}2e`;
        ctx.fill();
        ctx.clip();
        ctx.strokeStyle = `${colourOf(colour)}80`;
        ctx.lineWidth = ratio;
        for (let x = left - height; x < end; x += 7 * ratio) {
          ctx.beginPath();
          ctx.moveTo(x, top + height);
          ctx.lineTo(x + height, top);
          ctx.stroke();
        }
        const shown = fitted(ctx, text, end - left - 8 * ratio);
        if (shown) {
          const width = ctx.measureText(shown).width;
          ctx.fillStyle = isDark() ? '#1b212ae6' : '#ffffffe6';
          const middle = top + (row.index ? SHADE_HEIGHT * ratio : height) / 2, tall = (SHADE_HEIGHT - 4) * ratio;
          ctx.fillRect(left + 3 * ratio, middle - tall / 2, width + 4 * ratio, tall);
          ctx.fillStyle = colourOf('ink');
          ctx.fillText(shown, left + 5 * ratio, middle);
        }
        ctx.restore();
      }
      ctx.restore();
    }

    listen(row) {
      const over = row.plot.over;
      let pressed = null, pinch = null;
      over.addEventListener('mousedown', (event) => { pressed = event.clientX; });
      over.addEventListener('click', (event) => {
        if (pressed !== null && Math.abs(event.clientX - pressed) < 4) {
          this.options.onPick(row.plot.posToVal(event.clientX - over.getBoundingClientRect().left, 'x'));
        }
      });
      const places = (event) => [...event.touches].map((touch) => row.plot.posToVal(
        touch.clientX - over.getBoundingClientRect().left, 'x')).sort((a, b) => a - b);
      over.addEventListener('touchstart', (event) => {
        pinch = event.touches.length === 2 ? places(event) : null;
      }, {passive: true});
      over.addEventListener('touchmove', (event) => {
        if (!pinch || event.touches.length !== 2) return;
        event.preventDefault();
        const [from, to] = this.shown(), [left, right] = places(event);
        if (right - left < (to - from) / 100) return;
        // The instants under the fingers stay there.
        const factor = (pinch[1] - pinch[0]) / (right - left);
        const [first, last] = this.whole(), low = pinch[0] - (left - from) * factor;
        const high = low + (to - from) * factor;
        if (high - low >= 1) this.show(Math.max(low, first), Math.min(high, last));
        pinch = places(event);
      }, {passive: false});
      over.addEventListener('touchend', () => { pinch = null; });
    }

    width() { return Math.max(this.body.clientWidth, 200); }

    heightOf(row) {
      return row.height + (row.hasMarkers ? MARKER_HEIGHT : 0) + (row.isLast ? X_AXIS_HEIGHT : 0);
    }

    fit() {
      const width = this.width();
      for (const row of this.plots) {
        if (row.plot.width !== width) row.plot.setSize({width, height: this.heightOf(row)});
      }
    }

    recolour() {
      for (const row of this.plots) {
        for (const {series, line: sample} of row.legend) sample.setAttribute('stroke', colourOf(series.colour));
        row.plot.redraw(false);
      }
    }
  }

  function yRange(definition, low, high) {
    const {least, most, leastSpan = 0} = definition;
    let [from, to] = isNumber(low) && isNumber(high) ? [low, high] : [least === undefined ? 0 : least,
      most === undefined ? 1 : most];
    if (least !== undefined) from = Math.min(from, least);
    if (most !== undefined) to = Math.max(to, most);
    const lacking = Math.max(leastSpan - (to - from), to === from ? 1 : 0, 0);
    from -= least === undefined ? lacking / 2 : 0;
    to += least === undefined ? lacking / 2 : lacking;
    const room = (to - from) * 0.05;
    return [from === least ? from : from - room, to === most ? to : to + room];
  }

  // One table of several with times of their own; undefined, unlike null, is no gap.
  function merged(tables) {
    const filled = tables.filter((table) => table[0].length), columns = [[]], at = filled.map(() => 0);
    for (const table of tables) for (let index = 1; index < table.length; index++) columns.push([]);
    const offsets = new Map();
    let offset = 1;
    for (const table of tables) { offsets.set(table, offset); offset += table.length - 1; }
    for (let row = 0; ; row++) {
      let time = Infinity;
      filled.forEach((table, number) => { if (at[number] < table[0].length) time = Math.min(time, table[0][at[number]]); });
      if (time === Infinity) break;
      columns[0].push(time);
      filled.forEach((table, number) => {
        if (table[0][at[number]] !== time) return;
        const first = offsets.get(table);
        for (let index = 1; index < table.length; index++) columns[first + index - 1][row] = table[index][at[number]];
        at[number] += 1;
      });
    }
    for (const column of columns) column.length = columns[0].length;
    return columns;
  }

  function line(ctx, x, bbox) {
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }

  // A text that is at most `width` wide; '' where not even a few letters fit.
  function fitted(ctx, text, width) {
    if (ctx.measureText(text).width <= width) return text;
    const letters = Math.floor(width / (ctx.measureText(text).width / text.length)) - 1;
    return letters >= 3 ? `${text.slice(0, letters)}…` : '';
  }

  return {create: (parent, options) => new Curves(parent, options), COLOURS, DASHES, clockText};
})();

// SPDX-License-Identifier: Apache-2.0
(() => {
  'use strict';
  const contents = JSON.parse(document.getElementById('data').textContent);
  const {recorded, changed} = contents, [recordedName, changedName] = contents.courses;

  function floats(text, Kind) {
    const bytes = atob(text), buffer = new Uint8Array(bytes.length);
    for (let index = 0; index < bytes.length; index++) buffer[index] = bytes.charCodeAt(index);
    // Files are little-endian, as is every browser of today.
    return new Kind(buffer.buffer);
  }
  const data = {time: floats(recorded.time, Float64Array)};
  for (const name of Object.keys(recorded.columns)) data[name] = floats(recorded.columns[name], Float32Array);
  if (changed) {
    data.changed_time = floats(changed.time, Float64Array);
    for (const name of Object.keys(changed.columns)) {
      data[`changed_${name}`] = floats(changed.columns[name], Float32Array);
    }
  }
  // The power of each of several heat sources on top of the one before.
  const sources = Object.keys(recorded.sources);
  sources.forEach((name, index) => {
    const own = data[`own${index}`] = floats(recorded.sources[name], Float32Array), below = data[`stack${index - 1}`];
    data[`stack${index}`] = own.map((power, place) => power + (below ? below[place] : 0));
  });
  const has = (name) => data[name] && data[name].some((value) => !Number.isNaN(value));
  const known = (series) => series.filter((each) => each.times === 'plan_time' || has(each.key));

  // A log has no sentences; there the planner beside it has them.
  const told = recorded.sentences.length || !changed ? recorded : changed;
  const toldName = told === recorded ? recordedName : changedName;

  // Codes of changes over time; the end of the drive ends the last one.
  const end = data.time[data.time.length - 1];
  const regimes = [...new Set(told.regimes.map((change) => change[1]))];
  data.regime_time = told.regimes.map((change) => change[0]).concat(end);
  data.regime = told.regimes.map((change) => regimes.indexOf(change[1]));
  data.regime.push(data.regime[data.regime.length - 1]);
  const doubted = [...new Set(told.doubts.flatMap((change) => change.slice(1)))];
  // Each change holds until the next one; a signal has a level above those of the regimes.
  data.doubt_time = told.doubts.flatMap((change, index) => [change[0], (told.doubts[index + 1] || [end])[0]]);
  doubted.forEach((signal, number) => {
    data[`doubt_${signal}`] = told.doubts.flatMap((change) => Array(2).fill(
      change.slice(1).includes(signal) ? regimes.length + number : null));
  });

  const changedLine = (name, key, more) => Object.assign(
    {name: `${name}, ${changedName}`, key: `changed_${key}`, times: 'changed_time', colour: 'purple'}, more);
  const rows = [
    {title: 'Temperature', unit: '°C', height: 260, leastSpan: 2, series: known([
      {name: 'measured', key: 'measured', colour: 'ink'},
      {name: 'estimate', key: 'estimated', colour: 'green', dash: 'dashdot', low: 'estimated_low',
        high: 'estimated_high', digits: 2},
      {name: 'predicted on arrival', key: 'predicted', colour: 'blue', dash: 'dash', low: 'predicted_low',
        high: 'predicted_high', digits: 2},
      {name: 'target', key: 'target', colour: 'orange', dash: 'long'},
      {name: 'at most', key: 'most', colour: 'orange', dash: 'dashdot'},
      {name: 'ambient', key: 'ambient', colour: 'grey', dash: 'dot', off: true},
      {name: 'without heating', key: 'unheated', colour: 'grey', dash: 'dash'},
      changedLine('measured', 'measured'), changedLine('predicted', 'predicted', {dash: 'dash'}),
      {name: 'plan', key: 'plan_temperature', times: 'plan_time', colour: 'vermillion', dash: 'dot', width: 3}])},
    {title: sources.length ? 'Heat sources' : 'Heater', unit: 'kW', least: 0, height: 130, series: known([
      ...sources.map((name, index) => ({name, key: `stack${index}`, onto: index ? `stack${index - 1}` : '',
        own: `own${index}`, colour: ['vermillion', 'blue', 'green', 'orange', 'purple', 'grey'][index % 6], step: true,
        scale: 1e-3, digits: 2})),
      {name: told === recorded ? 'commanded' : 'recorded', key: 'commanded', colour: sources.length ? 'ink' : 'vermillion',
        step: true, scale: 1e-3, digits: 2},
      {name: 'confirmed', key: 'confirmed', colour: 'blue', dash: 'dash', step: true, scale: 1e-3, digits: 2},
      changedLine('commanded', 'commanded', {step: true, scale: 1e-3, digits: 2, dash: 'dashdot'}),
      {name: 'plan', key: 'plan_power', times: 'plan_time', colour: 'green', dash: 'dot', step: true, scale: 1e-3,
        digits: 2}])},
    {title: 'Charge', unit: '%', height: 130, series: known([
      {name: 'measured', key: 'soc', colour: 'ink', scale: 100},
      changedLine('measured', 'soc', {scale: 100}),
      {name: 'plan', key: 'plan_soc', times: 'plan_time', colour: 'vermillion', dash: 'dot', scale: 100}])},
    {title: 'Battery power', unit: 'kW', height: 130, series: known([
      {name: 'at the terminals', key: 'power', colour: 'blue', scale: 1e-3}])},
    {title: 'Regime and signals in doubt', height: 70, least: 0, noScale: true, series: [
      {name: 'regime', key: 'regime', times: 'regime_time', colour: 'ink', step: true, words: regimes},
      ...doubted.map((signal, level) => ({name: `${signal} in doubt`, key: `doubt_${signal}`, times: 'doubt_time',
        colour: ['vermillion', 'blue', 'green', 'purple', 'orange', 'grey'][level % 6], width: 5, step: true,
        words: Array(regimes.length + doubted.length).fill('yes')}))]}];

  const select = document.getElementById('plans'), said = document.getElementById('said');
  const moment = (at) => bevCurves.clockText(at, 'utc', true);
  const planSources = [[recorded, recordedName], ...(changed ? [[changed, changedName]] : [])];
  const plans = planSources.flatMap(([source, name]) => source.plans.map((plan) => ({plan, name})));
  plans.sort((a, b) => a.plan[0] - b.plan[0]);
  select.append(new Option(plans.length ? 'plan: none shown' : 'no plan in this drive', '-1'));
  plans.forEach(({plan, name}, index) => select.append(new Option(
    `${moment(plan[0])}  ${changed ? `${name}: ` : ''}${plan[1]}`, String(index))));

  const curves = bevCurves.create(document.getElementById('curves'), {
    rows: rows.filter((row) => row.series.some((series) => series.times !== 'plan_time')), data,
    markers: told.sentences.filter((change, index) => !index
      || change[1] !== told.sentences[index - 1][1]).map((change) => ({at: change[0], text: change[1]})),
    shades: contents.lapses.map(([from, to]) => ({from, to, text: 'no valid command', colour: 'orange', row: 1})),
    onPick: (at) => showAt(at)});

  function lastAt(changes, at) {
    let found = null;
    for (const change of changes) { if (change[0] > at) break; found = change; }
    return found;
  }

  function showPlan(index) {
    select.value = String(index);
    const plan = index < 0 ? null : plans[index].plan;
    const times = plan ? Array.from(floats(plan[3], Float32Array), (time) => plan[2] + time) : [];
    const column = (place) => (plan ? floats(plan[place], Float32Array) : []);
    curves.merge({plan_time: times, plan_temperature: column(4), plan_soc: column(5), plan_power: column(6)});
    if (plan) curves.pick(plan[0]);
  }

  function showAt(at) {
    let index = -1;
    plans.forEach(({plan, name}, number) => { if (plan[0] <= at && name === toldName) index = number; });
    showPlan(index);
    curves.pick(at);
    tellAt(at);
  }

  function tellAt(at) {
    const change = lastAt(told.sentences, at);
    said.textContent = change ? `${moment(at)}: ${change[1]}. ${change[2]}` : '';
  }

  select.addEventListener('change', () => choose(Number(select.value)));
  function choose(index) {
    const held = Math.min(Math.max(index, -1), plans.length - 1);
    showPlan(held);
    if (held >= 0) tellAt(plans[held].plan[0]); else curves.pick(null);
  }
  document.getElementById('plan-before').addEventListener('click', () => choose(Number(select.value) - 1));
  document.getElementById('plan-after').addEventListener('click', () => choose(Number(select.value) + 1));

  // A table of changes; a row shows its instant in the curves.
  function table(parent, headings, changes) {
    if (!changes.length) { parent.textContent = 'none'; return; }
    const filter = document.createElement('input'), count = document.createElement('span');
    filter.type = 'search';
    filter.className = 'filter';
    filter.placeholder = 'filter';
    filter.setAttribute('aria-label', 'filter');
    count.className = 'count';
    const scroll = document.createElement('div'), made = document.createElement('table');
    scroll.className = 'scroll tall';
    scroll.append(made);
    parent.append(filter, ' ', count, scroll);
    const head = made.createTHead().insertRow();
    for (const heading of ['at', ...headings]) {
      const cell = document.createElement('th');
      cell.textContent = heading;
      head.append(cell);
    }
    const body = made.createTBody(), lines = changes.map((change) => {
      const line = body.insertRow();
      line.tabIndex = 0;
      change.forEach((value, place) => {
        const cell = line.insertCell();
        cell.textContent = place ? value : moment(value);
        if (!place) cell.className = 'time';
        if (value === 'WARN' || value === 'ERROR') cell.className = value;
      });
      const show = () => {
        for (const other of document.querySelectorAll('tr.shown')) other.classList.remove('shown');
        line.classList.add('shown');
        showAt(change[0]);
      };
      line.addEventListener('click', show);
      line.addEventListener('keydown', (event) => { if (event.key === 'Enter') show(); });
      return [line, change.slice(1).join(' ').toLowerCase()];
    });
    const search = () => {
      const wanted = filter.value.toLowerCase();
      let number = 0;
      for (const [line, text] of lines) {
        line.hidden = !text.includes(wanted);
        number += line.hidden ? 0 : 1;
      }
      count.textContent = `${number} of ${lines.length}`;
    };
    filter.addEventListener('input', search);
    search();
  }
  const byTime = (a, b) => a[0] - b[0];
  const both = (name) => (changed
    ? [...recorded[name].map((change) => [change[0], recordedName, ...change.slice(1)]),
      ...changed[name].map((change) => [change[0], changedName, ...change.slice(1)])].sort(byTime) : recorded[name]);
  const drive = changed ? ['drive'] : [];
  table(document.getElementById('sentences'), [...drive, 'status', 'sentence'], both('sentences'));
  table(document.getElementById('diagnostics'), [...drive, 'entry', 'level', 'message'], both('diagnostics'));
  table(document.getElementById('signals'), ['', 'value'], [
    ...told.regimes.map((change) => [change[0], 'regime', change[1]]),
    ...told.doubts.map((change) => [change[0], 'in doubt', change.slice(1).join(', ') || 'none'])].sort(byTime));
  choose(plans.length ? 0 : -1);
  curves.pick(null);
  said.textContent = 'Click into the curves, or on a row below, for the sentence and the plan of that instant.';
  window.bevReport = {curves, showAt, choose};
})();

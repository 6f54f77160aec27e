// SPDX-License-Identifier: Apache-2.0
// Draws one view of a planner, and its curves.
const bevView = (() => {
  'use strict';
  const byId = (id) => document.getElementById(id);
  const NO_BREAK = '\u00a0', MINUS = '\u2212';
  // Word, and shape and colour, of each status.
  const STATUSES = {{statuses}};
  // Drives that began longer ago are shown from here on [s].
  const LONGEST_PAST_S = 4 * 3600, BEFORE_TRIP_S = 300;

  const isNumber = (value) => typeof value === 'number';
  const fixed = (value, digits) => (isNumber(value)
    ? value.toFixed(digits).replace(/^-(0(\.0+)?)$/, '$1').replace('-', MINUS) : '–');
  const put = (id, text) => { const place = byId(id); if (place.textContent !== text) place.textContent = text; };
  const statusOf = (name) => STATUSES[name] || [name || 'No plan yet', name ? 'warn' : 'off'];
  const readable = (text) => text.replaceAll(' degC', `${NO_BREAK}°C`).replaceAll('+-', '±');

  function duration(seconds) {
    const whole = Math.max(0, Math.round(seconds));
    const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
    const two = (number) => String(number).padStart(2, '0');
    return hours ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
  }

  const clock = (at) => bevCurves.clockText(at, 'local');

  function showStatus(view) {
    const [word, kind] = statusOf(view.status), status = document.querySelector('.status');
    if (status.dataset.kind !== kind) {
      status.dataset.kind = kind;
      byId('status-icon').setAttribute('href', `#icon-${kind}`);
    }
    put('status', word);
    const sentence = readable(view.sentence || 'The planner has not planned yet.');
    put('sentence', sentence);
    // Spoken only when the status changes: the sentence counts down.
    if (showStatus.spoken !== view.status) {
      showStatus.spoken = view.status;
      put('spoken', `${word}. ${sentence}`);
    }
    document.title = `${word} · Battery preheating`;
  }

  // The power of all heat sources, of the HVCH alone without others.
  const drawnBy = (view) => (view.sources.length ? view.sources.reduce((sum, [, power]) => sum + power, 0) : view.power);

  function showFigures(view) {
    put('temperature', fixed(view.temperature, 1));
    put('predicted', fixed(view.predicted, 1));
    put('spread', isNumber(view.deviation) ? `±${NO_BREAK}${view.deviation.toFixed(1)}` : '');
    const most = isNumber(view.most) ? `${NO_BREAK}…${NO_BREAK}${fixed(view.most, 1)}` : '';
    put('note-battery', `now and at arrival${
      isNumber(view.target) ? `, target ${fixed(view.target, 1)}${most}${NO_BREAK}°C` : ''}`);
    showCountdown(view);
    const isOne = !view.sources.length, drawn = drawnBy(view);
    put('title-heater', isOne ? 'Heater' : 'Heat sources');
    put('power', fixed(isNumber(drawn) ? drawn / 1000 : null, 1));
    put('note-heater', !isOne ? view.sources.filter(([, power]) => power > 0).map(([name, power]) => `${name}${NO_BREAK}${
      fixed(power / 1000, 1)}`).join(', ') || 'off' : !isNumber(view.power) ? 'no command yet' : isNumber(view.delivered)
      ? `commanded, ${fixed(view.delivered / 1000, 1)}${NO_BREAK}kW delivered` : view.power > 0 ? 'commanded' : 'off');
    put('soc', fixed(isNumber(view.soc) ? 100 * view.soc : null, 0));
    put('note-charge', isNumber(view.arrivalSoc) ? `${fixed(100 * view.arrivalSoc, 0)}${NO_BREAK}% at arrival${
      isNumber(view.reserve) ? `, reserve ${fixed(100 * view.reserve, 0)}${NO_BREAK}%` : ''}` : '');
    const saved = isNumber(view.charging) && isNumber(view.chargingUnheated)
      ? (view.chargingUnheated - view.charging) / 60 : null;
    put('saved', fixed(saved, Math.abs(saved) < 9.5 ? 1 : 0));
    put('note-saved', saved === null ? 'the charger is not known'
      : `${fixed(view.charging / 60, 0)} instead of ${fixed(view.chargingUnheated / 60, 0)}${NO_BREAK}min`);
  }

  function showCountdown(view) {
    const {at, heatingStart, heatingEnd, arrival} = view;
    const left = isNumber(arrival) && isNumber(at) ? arrival - at : null;
    let title = 'Arrival in', value = left, note = isNumber(arrival) ? `at ${clock(arrival)}` : 'no plan';
    if (left !== null && isNumber(heatingStart) && heatingStart > at + 1 && drawnBy(view) === 0) {
      title = 'Heating starts in';
      value = heatingStart - at;
      note = `arrival in ${duration(left)}`;
    } else if (left !== null && drawnBy(view) > 0 && isNumber(heatingEnd) && heatingEnd < arrival - 30 && heatingEnd > at) {
      note = `heating ends in ${duration(heatingEnd - at)}`;
    }
    if (left !== null && left < 0) { title = 'Arrived'; value = null; }
    put('title-time', title);
    put('countdown', value === null ? '–' : duration(value));
    put('note-time', note);
  }

  function showAges(view) {
    const late = new Set(view.late || []);
    for (const [id, topic] of [['figure-battery', 'battery'], ['figure-charge', 'battery'], ['figure-heater', 'command'],
      ['figure-time', 'plan'], ['figure-saved', 'plan']]) {
      byId(id).classList.toggle('late', late.has(topic));
    }
    document.querySelector('.hero').classList.toggle('late', late.has('plan'));
    if (!view.ages) return;
    const text = (age) => (isNumber(age) ? `${age < 10 ? age.toFixed(1) : age.toFixed(0)}${NO_BREAK}s ago` : 'never');
    put('footer', `Last heard: battery ${text(view.ages.battery)} · plan ${text(view.ages.plan)} · command ${
      text(view.ages.command)} · diagnostics ${text(view.ages.diagnostics)}`);
  }

  function showBanner(banner) {
    const place = byId('banner');
    place.hidden = !banner;
    if (!banner) return;
    place.dataset.level = banner.level;
    // An alert is spoken again when its text changes; the age alone is no news.
    const kind = banner.text.replace(/\d+/g, '#');
    if (place.dataset.kind !== kind || !place.textContent) place.textContent = banner.text;
    else if (place.firstChild.data !== banner.text) place.firstChild.data = banner.text;
    place.dataset.kind = kind;
  }

  function row(tag, cells) {
    const made = document.createElement(tag);
    for (const [cellTag, text, level] of cells) {
      const cell = document.createElement(cellTag);
      cell.textContent = text;
      if (level) cell.dataset.level = level;
      made.append(cell);
    }
    return made;
  }

  function showDetails(view) {
    const key = JSON.stringify([view.entries, view.regime, view.doubts, view.routeId, view.method, view.goal, view.outcome,
      view.departure, view.unheatedProblem, view.targetReason]);
    if (showDetails.key === key) return;
    showDetails.key = key;
    byId('entries').replaceChildren(...(view.entries || []).map(([name, level, text]) => row('tr', [
      ['td', name], ['td', level, level], ['td', readable(text)]])));
    const count = (view.entries || []).filter(([, level]) => level !== 'OK').length;
    put('details-note', count ? `${count} of ${view.entries.length} parts report a problem` : '');
    const facts = [
      ['Target', view.targetReason], ['Regime', view.regime],
      ['Signals in doubt', (view.doubts || []).join(', ')],
      ['Route', view.routeId], ['Method', view.method], ['Preparation', view.goal], ['Its end', view.outcome],
      ['Next departure', view.departure && view.departure.next_words], ['Departure', view.departure && view.departure.state],
      ['Skipped', view.departure && view.departure.skipped], ['Without heating', view.unheatedProblem]];
    byId('facts').replaceChildren(...facts.filter(([, text]) => text).flatMap(([name, text]) => {
      const [term, value] = [document.createElement('dt'), document.createElement('dd')];
      term.textContent = name;
      value.textContent = readable(text);
      return [term, value];
    }));
  }

  // The latest first.
  function showLog(marks) {
    const key = JSON.stringify(marks);
    if (showLog.key === key) return;
    showLog.key = key;
    byId('log-empty').hidden = marks.length > 0;
    byId('log').replaceChildren(...marks.slice(-40).reverse().map(([at, status, text]) => {
      const item = document.createElement('li'), time = document.createElement('time'), said = document.createElement('span');
      const word = document.createElement('b');
      time.textContent = clock(at);
      word.textContent = statusOf(status)[0];
      // Some sentences begin with the status.
      const rest = readable(text).replace(`${word.textContent}: `, '');
      said.append(word, `: ${rest}`);
      item.append(time, said);
      return item;
    }));
  }

  // Curves

  const ROWS = [
    {title: 'Temperature', unit: '°C', height: 250, leastSpan: 4, series: [
      {name: 'measured', key: 'measured', colour: 'blue', width: 2.5},
      {name: 'planned', key: 'planned', times: 'planTime', colour: 'blue', dash: 'dash', width: 2},
      {name: 'without heating', short: 'unheated', key: 'unheated', times: 'unheatedTime', colour: 'grey', dash: 'dot', width: 2},
      {name: 'target', key: 'target', times: 'targetTime', colour: 'ink', dash: 'long', width: 1.2,
        constant: true},
      {name: 'at most', key: 'most', times: 'mostTime', colour: 'ink', dash: 'dashdot', width: 1.2, constant: true},
      {name: 'at arrival', short: 'arrival', key: 'spread', low: 'spreadLow', high: 'spreadHigh', times: 'spreadTime', colour: 'purple',
        width: 3, constant: true}]},
    {title: 'Heater', unit: 'kW', height: 110, least: 0, leastSpan: 1, series: [
      {name: 'commanded', key: 'power', times: 'powerTime', colour: 'vermillion', step: true, scale: 0.001, width: 2.5},
      {name: 'delivered', key: 'delivered', times: 'deliveredTime', colour: 'blue', dash: 'dashdot', step: true,
        scale: 0.001},
      {name: 'planned', key: 'planPower', times: 'planTime', colour: 'vermillion', dash: 'dash', step: true,
        scale: 0.001}]},
    {title: 'Charge', unit: '%', height: 110, leastSpan: 5, series: [
      {name: 'measured', key: 'soc', colour: 'green', scale: 100, width: 2.5},
      {name: 'planned', key: 'planSoc', times: 'planTime', colour: 'green', dash: 'dash', scale: 100},
      {name: 'reserve', key: 'reserve', times: 'reserveTime', colour: 'vermillion', dash: 'dot', scale: 100,
        constant: true}]}];
  // Each of several heat sources on top of the one before: commanded until now, then planned.
  const STACK = ['vermillion', 'blue', 'green', 'orange', 'purple', 'grey'];
  const stackRow = (names) => ({...ROWS[1], title: 'Heat sources', series: names.map((name, index) => ({
    name, key: `stack${index}`, onto: index ? `stack${index - 1}` : '', own: `own${index}`, times: 'stackTime',
    colour: STACK[index % STACK.length], step: true, scale: 0.001}))});
  let curves = null, shownNow = null, shownNames = '';

  function stacked(names, history, ahead, first, at) {
    const past = steps(history, 'mix', first, at, true), {planTime} = ahead;
    const count = planTime.length ? lower(past.mixTime, planTime[0]) : past.mixTime.length;
    const made = {stackTime: past.mixTime.slice(0, count).concat(planTime)};
    let below = made.stackTime.map(() => 0);
    names.forEach((name, index) => {
      const own = past.mix.slice(0, count).map((row) => row[index]).concat(held(ahead.planMix[name] || planTime.map(() => 0)));
      made[`own${index}`] = own;
      made[`stack${index}`] = below = below.map((power, place) => power + own[place]);
    });
    return made;
  }


  function showCurves(view, history, plan, events) {
    const at = view.at, arrival = isNumber(view.arrival) && view.arrival > at ? view.arrival : at;
    const from = isNumber(view.tripFrom) ? Math.max(view.tripFrom - BEFORE_TRIP_S, at - LONGEST_PAST_S) : at - LONGEST_PAST_S;
    const past = sliced(history, 'time', ['measured', 'soc', 'unheated'], from, at);
    const first = past.time.length ? past.time[0] : at;
    // A command may be hours older than the first battery state.
    const powers = {...steps(history, 'power', first, at, true),
      ...steps(history, 'delivered', first, at, isNumber(view.delivered))};
    const ahead = plan || {planTime: [], planned: [], planUnheated: [], planSoc: [], planPower: [], planMix: {}};
    const names = view.sources.map(([name]) => name);
    const width = Math.max(arrival - first, 60) * 0.008;
    const hasSpread = isNumber(view.predicted) && arrival > at;
    const half = hasSpread && isNumber(view.deviation) ? view.deviation : 0;
    const twice = (value) => [value, value];
    const data = {
      ...past, ...powers, ...ahead, planPower: held(ahead.planPower), ...stacked(names, history, ahead, first, at),
      unheatedTime: past.time.concat(ahead.planTime), unheated: past.unheated.concat(ahead.planUnheated),
      targetTime: isNumber(view.target) ? [first, arrival] : [], target: twice(view.target),
      mostTime: isNumber(view.most) ? [first, arrival] : [], most: twice(view.most),
      spreadTime: hasSpread ? [arrival - width, arrival + width] : [], spread: twice(view.predicted),
      spreadLow: twice(view.predicted - half), spreadHigh: twice(view.predicted + half),
      reserveTime: isNumber(view.reserve) ? [first, arrival] : [], reserve: twice(view.reserve)};
    if (!data.time.length && !data.planTime.length) return;
    // Of several at one instant the last one counts.
    const markers = events.marks.filter(([instant], index, all) => instant >= from
      && !(index + 1 < all.length && all[index + 1][0] - instant < 1))
      .map(([instant, status, , label]) => ({at: instant, text: label ? readable(label) : statusOf(status)[0]}));
    const shades = [...events.regimes.filter(([, , text]) => text !== 'driving')
      .map(([begin, end, text]) => ({from: begin, to: end === null ? at : end, text, colour: 'green'})),
    ...events.doubts.map(([begin, end, text]) => ({from: begin, to: end === null ? at : end, text: `in doubt: ${text}`,
      colour: 'vermillion'})),
    ...events.lapses.map(([begin, end, text]) => ({from: begin, to: end === null ? at : end, text, colour: 'orange', row: 1}))];
    if (!curves || shownNames !== names.join()) {
      shownNames = names.join();
      byId('curves').replaceChildren();
      curves = bevCurves.create(byId('curves'), {
        rows: names.length ? [ROWS[0], stackRow(names), ROWS[2]] : ROWS, data, markers, shades, clock: 'local', endText: 'now'});
    } else {
      curves.setData(data);
      curves.setMarkers(markers);
      curves.setShades(shades);
    }
    if (shownNow !== at) { shownNow = at; curves.pick(at, 'now'); }
  }

  // The rows of a history after `from` until `to`.
  function sliced(history, time, keys, from, to) {
    const times = history[time], begin = lower(times, from), end = lower(times, to + 1e-6);
    const made = {time: times.slice(begin, end)};
    for (const key of keys) made[key] = history[key].slice(begin, end);
    return made;
  }

  function lower(values, wanted) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] < wanted) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Changes of a power, continued until now if it goes on.
  function steps(history, key, from, at, goesOn) {
    const times = `${key}Time`, end = lower(history[times], at + 1e-6);
    // The change before `from` holds there.
    const begin = Math.max(0, lower(history[times], from + 1e-6) - 1);
    const instants = history[times].slice(begin, end), values = history[key].slice(begin, end);
    if (instants.length && instants[0] < from) instants[0] = from;
    if (goesOn && instants.length && instants[instants.length - 1] < at) {
      instants.push(at);
      values.push(values[values.length - 1]);
    }
    return {[times]: instants, [key]: values};
  }

  // The last power of a plan holds until its end.
  function held(powers) {
    return powers.length > 1 ? [...powers.slice(0, -1), powers[powers.length - 2]] : powers;
  }

  function showView(view) {
    showBanner(view.banner);
    showStatus(view);
    showFigures(view);
    showAges(view);
    showDetails(view);
  }

  function showLink(state, text) {
    byId('link').dataset.state = state;
    put('link-text', text);
  }

  return {showView, showCurves, showLog, showBanner, showLink, statusOf, readable, put, byId};
})();

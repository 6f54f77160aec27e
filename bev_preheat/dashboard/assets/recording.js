// SPDX-License-Identifier: Apache-2.0
// Plays a recording: each position of the slider is a view as the live page would have shown it.
(() => {
  'use strict';
  if (document.body.dataset.mode !== 'recording') return;
  const {byId} = bevView;
  const PERIOD_MS = 200, RETRY_MS = 400;
  const slider = byId('slider'), play = byId('play');
  let tables = null, times = [], planTimes = [], at = 0, timer = null, shown = -1;

  async function load() {
    let answer;
    try {
      answer = await (await fetch('/recording.json')).json();
    } catch {
      answer = {problem: 'The dashboard does not answer.'};
    }
    if (answer.problem) {
      bevView.showBanner({level: 'error', text: answer.problem});
      bevView.showLink('lost', 'no recording');
    } else if (!answer.drives) {
      byId('player-time').textContent = `reading the recording, ${Math.round(100 * answer.progress)} %`;
      setTimeout(load, RETRY_MS);
    } else {
      start(answer);
    }
  }

  function start(answer) {
    byId('remarks').replaceChildren(...answer.remarks.map((text) => {
      const item = document.createElement('li');
      item.textContent = text;
      return item;
    }));
    bevView.showLink('late', `recording ${document.body.dataset.name}`);
    if (!answer.drives.length) {
      byId('player-time').textContent = 'nothing is recorded';
      return;
    }
    // The clock was set back between them, as when a simulation starts again.
    const select = byId('drive');
    byId('drives').hidden = answer.drives.length < 2;
    select.replaceChildren(...answer.drives.map((drive, index) => {
      const option = document.createElement('option');
      option.value = String(index);
      option.textContent = `${index + 1} of ${answer.drives.length}`;
      return option;
    }));
    select.addEventListener('change', () => choose(answer.drives[Number(select.value)]));
    choose(answer.drives[0]);
  }

  function choose(drive) {
    tables = drive;
    const column = tables.keys.indexOf('at');
    times = tables.frames.map((frame) => frame[column]);
    planTimes = tables.plans.map((plan) => plan.at);
    slider.max = String(times.length - 1);
    slider.disabled = false;
    shown = -1;
    showResults();
    // Of several at one instant only the last one has a frame.
    bevView.showLog(tables.events.marks.filter(([instant], index, all) => !(index + 1 < all.length
      && all[index + 1][0] === instant)), go);
    // The whole drive is seen from its end.
    go(times[times.length - 1]);
  }

  function showResults() {
    const lines = tables.results.flatMap(([instant, arrival, energy], index) => {
      const line = document.createElement('p'), button = document.createElement('button'), more = document.createElement('p');
      line.className = 'sentence';
      button.type = 'button';
      button.textContent = bevView.readable(arrival);
      button.title = `go to ${bevView.clock(instant)}`;
      button.addEventListener('click', () => go(instant));
      line.append(button);
      more.className = 'note';
      const lapses = tables.lapses && index === tables.results.length - 1
        ? ` Without a valid command: ${tables.lapses} (shaded below).` : '';
      more.textContent = `${energy}${lapses}`;
      return [line, more];
    });
    if (!lines.length) {
      const line = document.createElement('p');
      line.className = 'sentence';
      line.textContent = 'No trip was planned in this recording.';
      lines.push(line);
    }
    byId('results').replaceChildren(...lines);
  }

  function viewOf(index) {
    const view = {}, entries = tables.keys.indexOf('entries');
    tables.keys.forEach((key, column) => { view[key] = tables.frames[index][column]; });
    // null: those of the frame before.
    for (let before = index; !view.entries && before >= 0; before--) view.entries = tables.frames[before][entries];
    return view;
  }

  function go(instant) {
    at = Math.min(Math.max(instant, times[0]), times[times.length - 1]);
    const index = Math.max(0, bevView.lower(times, at + 1e-6) - 1);
    if (index === shown) return;
    shown = index;
    const view = viewOf(index), plan = tables.plans[Math.max(0, bevView.lower(planTimes, times[index] + 1e-6) - 1)];
    const {marks, regimes, doubts, lapses} = tables.events;
    const until = (list) => list.filter(([begin]) => begin <= times[index] + 1e-6);
    bevView.showView(view);
    bevView.showCurves(view, tables.history, plan, {
      marks: until(marks), regimes: until(regimes), doubts: until(doubts), lapses: until(lapses)});
    bevView.showLogAt(times[index]);
    slider.value = String(index);
    const text = `${bevCurves.clockText(times[index], 'local', true)} · ${bevView.duration(times[index] - times[0])} of ${
      bevView.duration(times[times.length - 1] - times[0])}`;
    slider.setAttribute('aria-valuetext', `${text}, ${bevView.statusOf(view.status)[0]}`);
    byId('player-time').textContent = text;
    byId('footer').textContent = 'A recording: nothing here happens now. Times are local; for preheat replay --explain this '
      + `instant is ${bevCurves.clockText(times[index], 'utc')} (UTC).`;
  }

  function stop() {
    clearInterval(timer);
    timer = null;
    play.textContent = 'Play';
    play.setAttribute('aria-pressed', 'false');
  }

  play.addEventListener('click', () => {
    if (timer) { stop(); return; }
    if (!tables) return;
    if (at >= times[times.length - 1]) go(times[0]);
    play.textContent = 'Pause';
    play.setAttribute('aria-pressed', 'true');
    let before = performance.now();
    timer = setInterval(() => {
      const now = performance.now();
      go(at + Number(byId('speed').value) * (now - before) / 1000);
      before = now;
      if (at >= times[times.length - 1]) stop();
    }, PERIOD_MS);
  });
  slider.addEventListener('input', () => go(times[Number(slider.value)]));
  bevView.onPick = (instant) => { if (tables) go(instant); };
  byId('chooser').hidden = true;
  load();
})();

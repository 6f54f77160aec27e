// SPDX-License-Identifier: Apache-2.0
// The live page: follows the server over a WebSocket, and connects again when that is gone.
(() => {
  'use strict';
  const {byId} = bevView;
  const RETRY_MS = 2000, SILENCE_MS = 6000;
  const EMPTY = {time: [], measured: [], soc: [], unheated: [], powerTime: [], power: [], deliveredTime: [],
    delivered: [], mixTime: [], mix: []};
  let socket = null, chosen = null, planners = [], heardMs = Date.now();
  let history = structuredClone(EMPTY), plan = null, events = {marks: [], regimes: [], doubts: [], lapses: []};

  function connect() {
    socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/tab`);
    socket.addEventListener('open', () => { chosen = null; });
    socket.addEventListener('message', (event) => take(JSON.parse(event.data)));
    socket.addEventListener('close', () => setTimeout(connect, RETRY_MS));
  }

  function take(message) {
    heardMs = Date.now();
    if (message.planners) takePlanners(message.planners);
    if (!message.view || message.planner !== chosen) return;
    if (message.history) {
      if (message.history.isWhole) history = structuredClone(EMPTY);
      for (const key of Object.keys(EMPTY)) history[key].push(...message.history[key]);
    }
    if (message.plan) plan = message.plan;
    if (message.events) events = message.events;
    const {view} = message, level = view.banner && view.banner.level;
    bevView.showView(view);
    bevView.showLink(level === 'error' ? 'lost' : level ? 'late' : 'live', level ? 'not live' : 'live');
    bevView.showLog(events.marks);
    if (typeof view.at === 'number') bevView.showCurves(view, history, plan, events);
    if (window.bevControls) bevControls.show(chosen, view);
  }

  function takePlanners(list) {
    planners = list;
    const names = list.map((each) => each.name), select = byId('planner');
    byId('chooser').hidden = list.length < 2;
    select.replaceChildren(...list.map((each) => {
      const option = document.createElement('option');
      option.value = each.name;
      option.textContent = `${each.name} · ${each.problem || bevView.statusOf(each.status)[0]}`;
      return option;
    }));
    const wanted = decodeURIComponent(location.hash.slice(1));
    if (names.includes(chosen)) select.value = chosen;
    else if (names.length) choose(names.includes(wanted) ? wanted : names[0]);
    else {
      chosen = null;
      bevView.showLink('late', 'no planner');
      bevView.put('status', 'No planner');
      bevView.put('sentence', 'No planner is running in this ROS domain. The page shows it as soon as it starts.');
    }
  }

  function choose(name) {
    chosen = name;
    byId('planner').value = name;
    history = structuredClone(EMPTY);
    plan = null;
    events = {marks: [], regimes: [], doubts: [], lapses: []};
    socket.send(JSON.stringify({planner: name}));
  }

  byId('planner').addEventListener('change', (event) => {
    window.history.replaceState(null, '', `#${encodeURIComponent(event.target.value)}`);
    choose(event.target.value);
  });

  // The server itself may be gone.
  setInterval(() => {
    const silentS = (Date.now() - heardMs) / 1000;
    if (silentS * 1000 < SILENCE_MS) return;
    if (!planners.length && socket.readyState === WebSocket.OPEN) return;
    bevView.showLink('lost', 'not connected');
    bevView.showBanner({level: 'error',
      text: `The dashboard does not answer, for ${silentS.toFixed(0)} s. All values on this page are old.`});
    for (const part of document.querySelectorAll('.figure, .hero')) part.classList.add('late');
  }, 1000);

  connect();
})();

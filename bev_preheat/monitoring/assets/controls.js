// SPDX-License-Identifier: Apache-2.0
// Buttons that ask the planner. Each asks back first, and shows the planner's answer.
window.bevControls = (() => {
  'use strict';
  const {byId} = bevView;
  if (!byId('actions')) return null;
  const QUICK_MIN = [15, 30, 60, 120];
  const WORDS = {
    enable: ['Switch preheating on?', 'The planner heats again when its plan asks for it.'],
    disable: ['Switch preheating off?', 'The heater stays off until preheating is switched on again, here or elsewhere.'],
    prepare: ['Have the battery warm', 'Also without a route. A goal that is already there is replaced.'],
    cancel: ['Cancel the preparation?', 'The planner forgets the goal and follows its route.'],
    skip: ['Skip the next departure?', ''],
    unskip: ['Take back all skipped departures?', 'The planner prepares the battery for them again.']};
  const dialog = byId('dialog'), answer = byId('dialog-answer'), ask = byId('dialog-ask');
  let planner = null, kind = null, latest = null;

  function open(asked) {
    kind = asked;
    const [title, text] = WORDS[asked];
    byId('dialog-title').textContent = title;
    byId('dialog-text').textContent = asked === 'skip' && latest && latest.departure ? latest.departure.next_words : text;
    byId('dialog-prepare').hidden = asked !== 'prepare';
    answer.hidden = true;
    ask.hidden = ask.disabled = false;
    byId('dialog-close').textContent = 'Go back';
    dialog.showModal();
    (asked === 'prepare' ? byId('minutes') : byId('dialog-close')).focus();
  }

  function tell(text, state) {
    answer.hidden = false;
    answer.dataset.kind = state;
    answer.textContent = bevView.readable(text);
  }

  async function send() {
    const values = {planner, kind};
    if (kind === 'prepare') {
      for (const id of ['minutes', 'target']) {
        if (!byId(id).reportValidity()) return;
        values[id] = byId(id).value === '' ? null : Number(byId(id).value);
      }
      values.pluggedIn = byId('plugged').checked;
    }
    ask.disabled = true;
    tell('Asking the planner …', 'wait');
    let result;
    try {
      const response = await fetch('/ask', {
        method: 'POST', headers: {'Content-Type': 'application/json'}, body: JSON.stringify(values)});
      const isJson = (response.headers.get('Content-Type') || '').startsWith('application/json');
      result = isJson ? await response.json() : {isAccepted: false, text: await response.text()};
    } catch {
      result = {isAccepted: false, text: 'The dashboard does not answer. Whether the planner was asked is not known.'};
    }
    tell(`${result.isAccepted ? 'Accepted' : 'Not done'}: ${result.text}`, result.isAccepted ? 'yes' : 'no');
    ask.disabled = false;
    // A refused goal can be changed and sent again.
    ask.hidden = result.isAccepted || kind !== 'prepare';
    byId('dialog-close').textContent = 'Close';
    byId('dialog-close').focus();
  }

  function show(name, view) {
    planner = name;
    latest = view;
    byId('do-enable').hidden = view.enabled !== false;
    byId('do-disable').hidden = view.enabled === false;
    byId('do-cancel').hidden = !view.goal;
    byId('do-skip').hidden = !(view.departure && view.departure.next_words);
    byId('do-unskip').hidden = !(view.departure && view.departure.skipped);
  }

  for (const name of Object.keys(WORDS)) byId(`do-${name}`).addEventListener('click', () => open(name));
  byId('dialog-quick').append(...QUICK_MIN.map((minutes) => {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = minutes < 60 ? `${minutes} min` : `${minutes / 60} h`;
    button.addEventListener('click', () => { byId('minutes').value = minutes; });
    return button;
  }));
  ask.addEventListener('click', send);
  // Enter in a field asks; it does not close the dialog.
  byId('dialog-form').addEventListener('submit', (event) => {
    if (event.submitter !== byId('dialog-close')) event.preventDefault();
  });
  byId('dialog-prepare').addEventListener('keydown', (event) => {
    if (event.key !== 'Enter') return;
    event.preventDefault();
    if (!ask.disabled && !ask.hidden) send();
  });
  return {show};
})();

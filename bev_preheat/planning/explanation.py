# SPDX-License-Identifier: Apache-2.0
"""One sentence for each outcome, with the figures that decided it."""

from bev_preheat.planning.schedule import HeldBack
from bev_preheat.planning.status import Status
from bev_preheat.planning.stretches import Reason


def duration_text(seconds):
    """Return a duration as 1:02:03 h or 12:34 min."""
    total = int(round(seconds))
    hours, minutes, rest = total // 3600, total // 60 % 60, total % 60
    return f'{hours}:{minutes:02d}:{rest:02d} h' if hours else f'{minutes}:{rest:02d} min'


def explain(status, plan, reserve):
    """Return the sentence for the status of a Plan; `reserve` is the state of charge to be left."""
    arrival = (f'arrival in {duration_text(plan.arrival_time_s)} at '
               f'{plan.arrival_temperature_c:.1f} degC')
    target = f'target {plan.target_temperature_c:.1f} degC'
    if status is Status.NO_CHARGING_PLANNED:
        if plan.stranding is not None:
            return ('No fast charging at the end of this route: no heating. '
                    f'{_stranding_sentence(plan.stranding)}')
        return f'No fast charging at the end of this route: no heating; {arrival}.'
    if status is Status.OUT_OF_CHARGE:
        heating = ('no heating' if plan.heating_start_s is None else
                   'only surplus regeneration is used for heating'
                   if all(stretch.reason is Reason.SURPLUS for stretch in plan.stretches) else
                   'the heating of this plan makes it worse')
        return f'{_stranding_sentence(plan.stranding)[:-1]}: {heating}.'
    if status is Status.NOT_NEEDED:
        return f'The battery gets warm enough without further heating: {arrival}, {target}.'
    if status is Status.WAITING:
        return f'Heating starts in {duration_text(plan.heating_start_s)}: {arrival}, {target}.'
    if status is Status.HEATING:
        return f'Heating: {arrival}, {target}.'
    if status is Status.TARGET_UNREACHABLE:
        means = ('The cabin leaves the heater no power' if plan.heating_start_s is None else
                 'Heating all the way is not enough' if plan.heating_start_s == 0.0 else
                 f'Heating from {duration_text(plan.heating_start_s)} on is not enough')
        return f'{means}: {arrival}, {plan.shortfall_k:.1f} K below the {target}.'
    heating = ('no heating' if plan.heating_start_s is None else
               'heating is on' if plan.heating_start_s == 0.0 else
               f'heating starts in {duration_text(plan.heating_start_s)}')
    if status is Status.SOC_LIMITED:
        reserve = f'{100 * reserve:.1f} %'
        if plan.soc_shortfall > 0.0:
            return (f'The battery arrives {100 * plan.soc_shortfall:.1f} % below the {reserve} that '
                    f'must be left: {heating}; {arrival}, {target}.')
        if plan.held_back is HeldBack.POWER:
            return (f'A battery that is emptier by more heating could not deliver what the route asks '
                    f'for; the target is missed by {plan.shortfall_k:.1f} K: {heating}; {arrival}, '
                    f'{target}.')
        return (f'To leave {reserve} in the battery the target is missed by '
                f'{plan.shortfall_k:.1f} K: {heating}; {arrival}, {target}.')
    if status is Status.POWER_LIMITED:
        return (f'In {duration_text(plan.undeliverable_at_s)} the route asks for '
                f'{plan.undeliverable_power_w / 1000:.1f} kW more than the battery can deliver; '
                f'{heating}; {arrival}, {target}.')
    raise ValueError(f'{status!r} is no outcome of planning')


def _stranding_sentence(stranding):
    """Return where the charge runs out, and how much is lacking."""
    return (f'The charge does not carry this trip: the battery is empty after '
            f'{duration_text(stranding.at_s)}, at km {stranding.at_m / 1000.0:.1f}; '
            f'{stranding.lacking_wh / 1000.0:.2f} kWh are lacking.')

# SPDX-License-Identifier: Apache-2.0
"""One sentence for each outcome, with the figures that decided it."""

from bev_preheat.planning.status import Status


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
        return f'No fast charging at the end of this route: no heating; {arrival}.'
    if status is Status.NOT_NEEDED:
        return f'The battery gets warm enough without further heating: {arrival}, {target}.'
    if status is Status.WAITING:
        return f'Heating starts in {duration_text(plan.heating_start_s)}: {arrival}, {target}.'
    if status is Status.HEATING:
        return f'Heating: {arrival}, {target}.'
    if status is Status.TARGET_UNREACHABLE:
        means = ('The cabin leaves the heater no power'
                 if plan.heating_start_s is None else 'Heating all the way is not enough')
        return f'{means}: {arrival}, {plan.shortfall_k:.1f} K below the {target}.'
    heating = ('no heating' if plan.heating_start_s is None else
               'heating is on' if plan.heating_start_s == 0.0 else
               f'heating starts in {duration_text(plan.heating_start_s)}')
    if status is Status.SOC_LIMITED:
        reserve = f'{100 * reserve:.1f} %'
        if plan.soc_shortfall > 0.0:
            return (f'The battery arrives {100 * plan.soc_shortfall:.1f} % below the {reserve} that '
                    f'must be left: {heating}; {arrival}, {target}.')
        return (f'To leave {reserve} in the battery the target is missed by '
                f'{plan.shortfall_k:.1f} K: {heating}; {arrival}, {target}.')
    if status is Status.POWER_LIMITED:
        return (f'In {duration_text(plan.undeliverable_at_s)} the route asks for '
                f'{plan.undeliverable_power_w / 1000:.1f} kW more than the battery can deliver; '
                f'{heating}; {arrival}, {target}.')
    raise ValueError(f'{status!r} is no outcome of planning')

"""Numbers that decide, of the effects: each with its unit, its meaning and where it comes from.

A file a subject; its group is named as the file is.
"""

from ident.effects.settings.bodies import ADDED_BODY as ADDED_BODY
from ident.effects.settings.bodies import RIGID_BODY as RIGID_BODY
from ident.effects.settings.contact import CONTACT as CONTACT
from ident.effects.settings.friction import FRICTION as FRICTION
from ident.effects.settings.gear import GEAR as GEAR
from ident.effects.settings.memory import MEMORY as MEMORY
from ident.effects.settings.ripple import RIPPLE as RIPPLE
from ident.effects.settings.sensing import SENSING as SENSING
from ident.effects.settings.transmission import TRANSMISSION as TRANSMISSION
from ident.effects.settings.typical import TYPICAL as TYPICAL

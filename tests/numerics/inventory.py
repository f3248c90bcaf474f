"""Closed forms of all rooms."""

import forms_camera
import forms_light
import forms_planner
import forms_target
import forms_validation

FORMS = [
    form for room in (forms_target, forms_camera, forms_planner, forms_light, forms_validation) for form in room.FORMS
]

from cpic_planner.confirm.curve import curve_job as curve_job
from cpic_planner.confirm.etc_check import checked_answers as checked_answers, needs_images as needs_images
from cpic_planner.confirm.plan import make_plan as make_plan, plan_job as plan_job
from cpic_planner.confirm.roc import roc_job as roc_job
from cpic_planner.confirm.scene import (
    confirm_job as confirm_job,
    confirm_scene as confirm_scene,
    scene_target as scene_target,
)
from cpic_planner.confirm.searched import AskedStar as AskedStar
from cpic_planner.confirm.stars import confirm_stars as confirm_stars, star_images_job as star_images_job

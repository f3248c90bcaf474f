from cpic_planner.confirm.curve import AskedStar as AskedStar, curve_job as curve_job, roc_job as roc_job
from cpic_planner.confirm.etc_check import checked_answers as checked_answers, needs_images as needs_images
from cpic_planner.confirm.plan import make_plan as make_plan, plan_job as plan_job
from cpic_planner.confirm.scene import (
    confirm_job as confirm_job,
    confirm_scene as confirm_scene,
    confirm_stars as confirm_stars,
    scene_target as scene_target,
    star_images_job as star_images_job,
)

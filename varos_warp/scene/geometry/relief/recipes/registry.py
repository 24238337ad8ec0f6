"""The recipes, by the names that a material block gives them as ``relief``."""

from varos_warp.scene.geometry.relief.recipes.concrete import Concrete
from varos_warp.scene.geometry.relief.recipes.plain import Plain
from varos_warp.scene.geometry.relief.recipes.rock import Rock
from varos_warp.scene.geometry.relief.recipes.sand import Sand
from varos_warp.scene.geometry.relief.recipes.sites import Recipe
from varos_warp.scene.geometry.relief.recipes.steel import Steel
from varos_warp.scene.geometry.relief.recipes.zinc import Zinc

RECIPES: dict[str, Recipe] = {recipe.name: recipe for recipe in (Rock(), Sand(), Steel(), Concrete(), Zinc(), Plain())}

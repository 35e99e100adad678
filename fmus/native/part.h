/* Makes the sources of a unit a part of a closed loop. A generated file defines PART(name), the part's own names, and
   PART_VALUES, the value reference of its time; it includes this first, then the sources. */

#ifndef PART_H
#define PART_H

#include "fmi2Functions.h"

#if defined(FMI2_ACTUAL_FUNCTION_PREFIX)
#define WHOLE(name) fmi2PasteB(FMI2_ACTUAL_FUNCTION_PREFIX, name)
#else
#define WHOLE(name) name
#endif
#undef fmi2FullName
#define fmi2FullName(name) WHOLE(PART(name))

#include "closed_loop.h"

/* What the mathematics takes from the whole: the names of variables, and the log. */
#undef unit_variables
#undef unit_refuse
#undef unit_warn
#undef unit_note
SHARED const variable WHOLE(unit_variables)[];
#define unit_variables (WHOLE(unit_variables) + PART_VALUES)
#define unit_refuse part_refuse
#define unit_warn part_warn
#define unit_note part_note

SHARED mathematics fmi2FullName(mathematics)(void);

mathematics fmi2FullName(mathematics)(void)
{
    return (mathematics){
        .state_size = unit_state_size, .workspace_size = unit_workspace_size, .initialise = unit_initialise,
        .prepare = unit_prepare, .restore = unit_restore, .advance = unit_advance, .complete = unit_complete,
    };
}

#endif
